// What both pages share: the secure socket with its token, the picture, the table of facts, and how old they are.
export const token = new URLSearchParams(location.hash.slice(1)).get("t") || "";
const SILENT = 2; // seconds without a word of the robot's after which nothing on the page holds any more
let silentSince = null, heard = performance.now(), connected = false, ended = false;

export function say(text, good) {
  const place = document.getElementById("said");
  if (place.textContent !== text) place.textContent = text;
  place.className = "state " + (good ? "good" : "bad");
}

// Seconds since the robot was heard: what the server said, and what has passed since it said so.
export function silence() {
  return silentSince === null ? Infinity : (performance.now() - heard) / 1000 + silentSince;
}

// Whether what the page shows is old; then it says so, in red, whatever it said before.
export function isSilent(started) {
  const age = silence(), silent = !connected || age >= SILENT;
  document.body.classList.toggle("silent", started && silent);
  if (started && silent && !ended) {
    if (!connected) say("no connection to the page's server, trying again", false);
    else if (age === Infinity) say("the robot has not been heard yet", false);
    else say(`the robot is silent for ${Math.floor(age)} s`, false);
  }
  return silent;
}

// Opens the socket, and again when it is lost; take(message) is given objects, picture(blob) images.
export function connect(role, hello, take, closed) {
  let wait = 250, over = false, socket = null;
  ended = false;
  const open = () => {
    socket = new WebSocket(`wss://${location.host}/${role}`);
    const own = socket;
    own.binaryType = "arraybuffer";
    own.onopen = () => { wait = 250; own.send(JSON.stringify({ token, ...hello() })); };
    own.onmessage = (message) => {
      if (over) return;
      connected = true;
      if (typeof message.data !== "string") { picture(message.data); return; }
      const told = JSON.parse(message.data);
      if (told.silent !== undefined) { silentSince = told.silent; heard = performance.now(); }
      take(told, own);
    };
    own.onclose = (event) => {
      if (over) return;
      connected = false;
      closed();
      if (event.code === 1008) { ended = true; say(event.reason || "refused", false); return; }
      setTimeout(() => { if (!over) open(); }, wait);
      wait = Math.min(2 * wait, 4000);
    };
  };
  open();
  return () => { over = true; connected = false; socket.close(); };
}

let shown = "";
function picture(data) {
  const url = URL.createObjectURL(new Blob([data], { type: "image/jpeg" }));
  document.getElementById("view").src = url;
  if (shown) URL.revokeObjectURL(shown);
  shown = url;
}

// Names of facts in the order in which they are shown, with what stands for them and their unit; others come after.
const NAMES = [
  ["images sent", "images sent"],
  ["age median ms", "age of its images", "ms"], ["ms", "work in a frame", "ms"],
  ["link", "worn camera"], ["started", "map begun"], ["metric", "lengths in metres"],
  ["position sd m", "position, 1 sd", "m"], ["attitude sd deg", "attitude, 1 sd", "°"], ["scale sd", "scale, 1 sd"],
  ["accepted", "features used"], ["map size", "features in the map"], ["cf matches", "matches with the worn camera"],
  ["used", "its views used"], ["images", "its images received"], ["clock drift ppm", "drift of its clock", "ppm"],
];
const NUMBER = /^-?[0-9]+(\.[0-9]+)?$/;
const WORDS = { True: "yes", False: "no", collab: "used", mono: "not used" };

// [label, value with unit, rank] of a fact; those of a device begin with its name.
function row(name, value) {
  const at = name.lastIndexOf(": "), device = at > 0 ? name.slice(0, at + 2) : "", own = name.slice(device.length);
  const rank = NAMES.findIndex(([key]) => key === own);
  const [, label, unit] = rank < 0 ? [own, own] : NAMES[rank];
  const number = NUMBER.test(value) ? String(Number(Number(value).toPrecision(3))) : WORDS[value] || value;
  return [device + label, unit && NUMBER.test(value) ? `${number} ${unit}` : number, rank < 0 ? 100 : rank];
}

function fill(id, rows) {
  document.getElementById(id).replaceChildren(...rows.map(([label, value]) => {
    const line = document.createElement("tr");
    for (const text of [label, value]) line.appendChild(document.createElement("td")).textContent = text;
    if (String(value).length > 16) line.lastChild.className = "text";
    return line;
  }));
}

export function facts(values) {
  const rows = Object.entries(values).map(([name, value]) => row(name, String(value)));
  rows.sort((a, b) => a[2] - b[2]);
  fill("facts", rows.filter((r) => r[2] < 100));
  fill("more", rows.filter((r) => r[2] >= 100));
}
