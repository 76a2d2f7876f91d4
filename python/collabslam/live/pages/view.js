// Both pictures, the way from above with its uncertainty, the map, and what there is to say of it.
import { connect, facts, say } from "/link.js";

const canvas = document.getElementById("map"), pen = canvas.getContext("2d");
const NEAR = 8; // so far from the camera points of the map are shown whole
let way = [], points = [], persons = [], heard = 0, unit = "m";

function take(message) {
  if (message.refused) { say(message.refused, false); return; }
  heard = performance.now();
  if (message.way) way = message.way;
  if (message.point) { way.push(message.point); if (way.length > 5000) way.shift(); }
  if (message.map) points = message.map;
  if (message.persons) persons = Object.entries(message.persons);
  if (message.facts) { facts(message.facts); unit = message.facts.metric === "True" ? "m" : "units"; }
  if (message.status) say(`${message.status} · ${message.link}`, message.status === "OK");
}

// W's x to the right and z upwards; the way fits, and what of the map is near the camera.
function draw() {
  requestAnimationFrame(draw);
  if (performance.now() - heard > 3000 && heard) say("the robot is silent", false);
  const style = getComputedStyle(document.body).color;
  const { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  if (!way.length) return;
  const [x, z, a, b, turn] = way[way.length - 1];
  const shown = [...way, ...persons.map(([, p]) => p), ...points.filter((p) => Math.hypot(p[0] - x, p[1] - z) < NEAR)];
  const xs = shown.map((p) => p[0]), zs = shown.map((p) => p[1]);
  const left = Math.min(...xs) - 1, right = Math.max(...xs) + 1, low = Math.min(...zs) - 1, high = Math.max(...zs) + 1;
  const scale = Math.min(width / (right - left), height / (high - low));
  const at = (x, z) => [width / 2 + (x - (left + right) / 2) * scale, height / 2 - (z - (low + high) / 2) * scale];
  pen.fillStyle = "#d98200";
  for (const p of points) { const [u, v] = at(...p); pen.fillRect(u - 1.5, v - 1.5, 3, 3); }
  pen.strokeStyle = style;
  pen.lineWidth = 2;
  pen.beginPath();
  way.forEach((p, k) => pen[k ? "lineTo" : "moveTo"](...at(p[0], p[1])));
  pen.stroke();
  pen.strokeStyle = "#2f7de1";
  pen.beginPath();
  pen.ellipse(...at(x, z), Math.max(2, 3 * a * scale), Math.max(2, 3 * b * scale), -turn, 0, 2 * Math.PI);
  pen.stroke();
  pen.strokeStyle = pen.fillStyle = "#b97f0a";
  pen.font = "20px system-ui";
  for (const [name, [x, z, a, b, turn]] of persons) {
    pen.beginPath();
    pen.ellipse(...at(x, z), Math.max(4, 3 * a * scale), Math.max(4, 3 * b * scale), -turn, 0, 2 * Math.PI);
    pen.stroke();
    const [u, v] = at(x, z);
    pen.fillText(name, u + 8, v - 8);
  }
  const metre = 10 ** Math.floor(Math.log10((right - left) / 3));
  pen.fillStyle = style;
  pen.fillRect(20, height - 24, metre * scale, 3);
  pen.fillText(`${metre} ${unit}`, 20, height - 32);
}

connect("view", () => ({}), take, () => {});
draw();
