// Both pictures, the path from above with its uncertainty, the map, and what there is to say of it.
import { connect, facts, isSilent, say } from "/link.js";

const canvas = document.getElementById("map"), pen = canvas.getContext("2d");
const NEAR = 8; // so far from the camera points of the map are shown whole
const SEEN = 9; // pixels below which an ellipse is drawn dashed around what is too small to be seen
let path = [], points = [], persons = [], unit = "m", status = "", waits = "", link = "", box = null;

function take(message) {
  if (message.trajectory) path = message.trajectory;
  else if (message.point) { path.push(message.point); if (path.length > 5000) path.shift(); }
  if (message.map) points = message.map;
  if (message.persons) persons = Object.entries(message.persons);
  if (message.facts) { facts(message.facts); unit = message.facts.metric === "True" ? "m" : "units"; waits = message.facts["waits for"]; }
  if (message.status) [status, link] = [message.status, message.link];
}

const colour = (name) => getComputedStyle(document.body).getPropertyValue(name);

// What is shown: it grows when something leaves it and shrinks when most of it is empty, so that it rarely moves.
function fitted(shown, aspect) {
  const xs = shown.map((p) => p[0]), zs = shown.map((p) => p[1]);
  const now = [Math.min(...xs) - 1, Math.max(...xs) + 1, Math.min(...zs) - 1, Math.max(...zs) + 1];
  const inside = box && now[0] >= box[0] && now[1] <= box[1] && now[2] >= box[2] && now[3] <= box[3];
  const small = box && Math.max((now[1] - now[0]) / (box[1] - box[0]), (now[3] - now[2]) / (box[3] - box[2])) < 0.4;
  if (!inside || small || box[4] !== aspect) {
    const wide = Math.max(now[1] - now[0], (now[3] - now[2]) * aspect) * 0.65, x = (now[0] + now[1]) / 2, z = (now[2] + now[3]) / 2;
    box = [x - wide, x + wide, z - wide / aspect, z + wide / aspect, aspect];
  }
  return box;
}

function ellipse(at, [x, z, a, b, turn], scale, size) {
  const wide = 3 * a * scale, high = 3 * b * scale, hidden = wide < SEEN * size;
  pen.setLineDash(hidden ? [3 * size, 3 * size] : []);
  pen.beginPath();
  pen.ellipse(...at(x, z), Math.max(SEEN * size, wide), Math.max(hidden ? SEEN * size : 2, high), -turn, 0, 2 * Math.PI);
  pen.globalAlpha = 0.2;
  pen.fill();
  pen.globalAlpha = 1;
  pen.stroke();
  pen.setLineDash([]);
}

function arrow(at, [x, z, , , , heading], size) {
  const [u, v] = at(x, z), long = 26 * size, c = Math.cos(heading), s = Math.sin(heading);
  pen.beginPath();
  for (const [along, aside] of [[0, 0], [long, 0], [long - 9 * size, 6 * size], [long, 0], [long - 9 * size, -6 * size]]) {
    pen.lineTo(u + along * c - aside * s, v - (along * s + aside * c));
  }
  pen.stroke();
}

// W's x to the right and z upwards; the path fits, and what of the map is near the camera.
function draw() {
  requestAnimationFrame(draw);
  if (!isSilent(true) && status) say(waits ? `waits for ${waits}` : `${status} · ${link === "collab" ? "with the worn camera" : "alone"}`, status === "OK");
  const size = devicePixelRatio * Math.max(1, canvas.clientWidth / 900);
  const width = Math.round(canvas.clientWidth * devicePixelRatio), height = Math.round(canvas.clientHeight * devicePixelRatio);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  pen.clearRect(0, 0, width, height);
  if (!path.length) return;
  const last = path[path.length - 1], [x, z, a, b] = last;
  const shown = [...path, ...persons.map(([, p]) => p), ...points.filter((p) => Math.hypot(p[0] - x, p[1] - z) < NEAR)];
  const [left, right, low, high] = fitted(shown, width / height);
  const scale = width / (right - left);
  const at = (x, z) => [(x - left) * scale, height - (z - low) * scale];
  pen.lineWidth = 2 * size;
  pen.font = `${14 * size}px system-ui`;
  pen.fillStyle = colour("--map");
  for (const p of points) { const [u, v] = at(...p); pen.fillRect(u - 1.5 * size, v - 1.5 * size, 3 * size, 3 * size); }
  pen.strokeStyle = colour("--path");
  pen.beginPath();
  path.forEach((p, k) => pen[k ? "lineTo" : "moveTo"](...at(p[0], p[1])));
  pen.stroke();
  pen.strokeStyle = pen.fillStyle = colour("--worn");
  for (const [name, place] of persons) {
    ellipse(at, place, scale, size);
    arrow(at, place, size);
    const [u, v] = at(place[0], place[1]), left = place[0] < x; // away from the robot
    pen.textAlign = left ? "right" : "left";
    pen.fillText(name || "worn", u + (left ? -14 : 14) * size, v + 5 * size);
  }
  pen.strokeStyle = pen.fillStyle = colour("--place");
  ellipse(at, last, scale, size);
  arrow(at, last, size);
  document.getElementById("sd").textContent = `${(3 * a).toPrecision(2)} by ${(3 * b).toPrecision(2)} ${unit}`;
  pen.textAlign = "left";
  const metre = 10 ** Math.floor(Math.log10((right - left) / 3));
  pen.fillStyle = colour("--ink");
  pen.fillRect(16 * size, height - 16 * size, metre * scale, 3 * size);
  pen.fillText(`${metre} ${unit}`, 16 * size, height - 24 * size);
}

connect("view", () => ({}), take, () => {});
draw();
