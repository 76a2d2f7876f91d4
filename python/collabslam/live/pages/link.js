// What both pages share: the secure socket with its token, the picture, the table of facts, and how old each is.
export const token = new URLSearchParams(location.hash.slice(1)).get("t") || "";
const SILENT = 2; // seconds without a word of the robot's after which nothing on the page holds any more
let ages = {}, heard = performance.now(), connected = false, ended = false;

export function say(text, good) {
  const place = document.getElementById("said");
  if (place.textContent !== text) place.textContent = text;
  place.className = "state " + (good ? "good" : "bad");
}

// Seconds since the robot told a kind of fact, or anything: what the server said, and what has passed since it said so.
function age(kind) {
  const said = kind ? ages[kind] ?? Infinity : Math.min(...Object.values(ages));
  return (performance.now() - heard) / 1000 + said;
}

// Writes into each place of the class "age" how old its kind of fact is; beyond its limit it is red, and its section grey.
function showAges() {
  for (const place of document.querySelectorAll(".age")) {
    const seconds = age(place.dataset.of), old = seconds < Infinity && seconds >= Number(place.dataset.limit);
    place.textContent = seconds === Infinity ? "none yet" : `${seconds < 10 ? seconds.toFixed(1) : Math.floor(seconds)} s old`;
    place.classList.toggle("bad", old);
    if (place.parentElement.tagName === "H2") place.closest("section").classList.toggle("stale", old);
  }
}
setInterval(showAges, 250);

// Whether what the page shows is old; then it says so, in red, whatever it said before.
export function isSilent(started) {
  const quiet = age(), silent = !connected || quiet >= SILENT;
  document.body.classList.toggle("silent", started && silent);
  if (started && silent && !ended) {
    if (!connected) say("no connection to the page's server, trying again", false);
    else if (quiet === Infinity) say("the robot has not been heard yet", false);
    else say(`the robot is silent for ${Math.floor(quiet)} s`, false);
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
      if (told.ages) { ages = told.ages; heard = performance.now(); showAges(); }
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

// Names of facts in the order in which they are shown: what stands for them, their unit, and how many of it a one is; others come after.
const NAMES = [
  ["images sent", "images sent"],
  ["age median ms", "age of its images", "ms"], ["last image s", "its last image", "s ago"], ["ms", "time for a frame", "ms"],
  ["link", "worn camera"], ["started", "map begun"], ["metric", "lengths in metres"],
  ["position sd m", "position uncertainty, 1 sd", "m"], ["attitude sd deg", "attitude uncertainty, 1 sd", "°"], ["scale sd", "scale uncertainty, 1 sd", "%", 100],
  ["accepted", "features used"], ["map size", "features in the map"], ["cf matches", "matches with the worn camera"],
  ["used", "its views used"], ["images", "its images received"], ["clock drift ppm", "drift of its clock", "ppm"],
];
const NUMBER = /^-?[0-9]+(\.[0-9]+)?$/;
const WORDS = { True: "yes", False: "no", collab: "used", mono: "not used", inf: "not known" };
const LATER = ["metric", "position sd m", "attitude sd deg", "scale sd"]; // that say nothing before the map has begun

// [label, value with unit, rank, whether all is well] of a fact; those of a device begin with its name.
function row(name, value) {
  const at = name.lastIndexOf(": "), device = at > 0 ? name.slice(0, at + 2) : "", own = name.slice(device.length);
  const rank = NAMES.findIndex(([key]) => key === own);
  const [, label, unit, times = 1] = rank < 0 ? [own, own] : NAMES[rank], counted = NUMBER.test(value);
  const number = counted && unit === "s ago" ? Number(value).toFixed(1) : counted ? String(Number((times * value).toPrecision(3))) : WORDS[value] || value;
  const good = own !== "last image s" || value < SILENT;
  return [device + label, unit && counted ? `${number} ${unit}` : number, rank < 0 ? 100 : rank, good];
}

function fill(id, rows) {
  document.getElementById(id).replaceChildren(...rows.map(([label, value, , good]) => {
    const line = document.createElement("tr");
    for (const text of [label, value]) line.appendChild(document.createElement("td")).textContent = text;
    if (String(value).length > 16) line.lastChild.className = "text";
    if (!good) line.className = "bad";
    return line;
  }));
}

export function facts(values) {
  const told = Object.entries(values).filter(([name]) => values.started !== "False" || !LATER.includes(name));
  const rows = told.map(([name, value]) => row(name, String(value)));
  rows.sort((a, b) => a[2] - b[2]);
  fill("facts", rows.filter((r) => r[2] < 100));
  fill("more", rows.filter((r) => r[2] >= 100));
}
