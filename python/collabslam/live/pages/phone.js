// The camera's images as JPEGs with the time of their capture, as many as the robot has use for.
import { connect, facts, isSilent, say } from "/link.js";
import { listen, rates } from "/motion.js";
import { possible, track } from "/tracked.js";

const video = document.getElementById("video");
const plain = document.getElementById("start"), tracked = document.getElementById("track");
const seconds = (ms) => (performance.timeOrigin + ms) / 1000;
let waits = "", socket = null, busy = false, last = -Infinity, sent = 0, asking = null, started = false, lost = false, own = null, problem = "", trackable = false;
const shown = new Set(["started", "metric", "cf matches"]);
let level = { width: 640, quality: 0.5, rate: 10 };

function begun(yes, why = "") {
  started = plain.hidden = yes;
  tracked.hidden = yes || !trackable;
  video.hidden = !yes;
  problem = why;
}

// Before the start the page shows what the robot sees, and sends nothing.
let stop = connect("phone", () => ({ watch: true }), (message) => { if (message.facts) tell(message.facts); }, () => {});

function send_as(hello) {
  stop();
  stop = connect("phone", hello, take, () => { socket = own = null; });
}

async function start() {
  begun(true);
  listen(); // first, while the press of the button counts
  try {
    const wanted = { facingMode: "environment", width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    video.srcObject = await navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
    await video.play();
  } catch (error) {
    begun(false, `The camera cannot be used: ${error.message}. Allow it in the browser, and open this page with https.`);
    return;
  }
  send_as(() => ({ width: video.videoWidth, height: video.videoHeight }));
  video.requestVideoFrameCallback(frame);
  if (navigator.wakeLock) navigator.wakeLock.request("screen").catch(() => {});
}

// The phone tracks itself: images come from the session, and the plain camera is its own meanwhile.
async function startTracked() {
  begun(true);
  let camera = null;
  const turned = (now) => now.width !== camera.width || now.intrinsics.some((v, k) => Math.abs(v - camera.intrinsics[k]) > 0.02 * now.width);
  const shot = (time, now, from, read) => {
    if (!camera) {
      camera = now;
      send_as(() => camera);
    }
    lost = turned(now);
    if (lost) { say("Hold the phone as it was at the start.", false); return; }
    if (!due(time)) return;
    const width = Math.min(level.width, camera.width), height = Math.round(width * camera.height / camera.width);
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext("2d").putImageData(read(width, height), 0, 0);
    busy = true;
    last = time;
    send(canvas, time, from).finally(() => { busy = false; });
  };
  video.hidden = true; // the session shows the camera itself
  try {
    await track(document.body, shot, () => { lost = true; say("The phone has lost itself. Move it slowly, towards things that can be seen.", false); }, () => location.reload());
  } catch (error) {
    begun(false, `This phone does not track itself here (${error.message}). Start the camera; a tag that both see tells its place.`);
  }
}

function take(message, from) {
  if (message.refused) { begun(false, message.refused); return; }
  if (message.ready) {
    socket = from;
    clearInterval(asking);
    asking = setInterval(() => from.readyState === 1 && from.send(JSON.stringify({ ask: seconds(performance.now()) })), 500);
    from.send(JSON.stringify({ ask: seconds(performance.now()) }));
  }
  if (message.asked !== undefined) {
    const back = seconds(performance.now());
    from.send(JSON.stringify({ exchange: [message.asked, message.received, message.answered, back] }));
  }
  if (message.level) level = message.level;
  if (message.own) own = message.own;
  if (message.facts) { tell(message.facts); look(message.facts); }
}

function tell(said) {
  waits = said["waits for"] || "";
  const own = Object.entries(said).filter(([name]) => shown.has(name) || (started && name.includes(":")));
  facts({ ...(started ? { "images sent": sent } : {}), ...Object.fromEntries(own) });
}

// What becomes of the images, said again as long as it holds: old words are worse than none.
setInterval(() => {
  if (problem) { say(problem, false); return; }
  if (isSilent(true) || lost) return;
  if (!started && waits) say(`The camera is off: start it. The robot waits for ${waits}.`, true);
  else if (!started) say("The camera is off. Below is what the robot sees.", true);
  else if (own) say(own.text, own.good);
  else say("Sending; the robot has not said yet what becomes of your images.", false);
}, 250);

function due(now) {
  return socket && !busy && socket.bufferedAmount <= 60000 && now - last >= 900 / level.rate;
}

// An arrow to where this camera should look, as its picture stands on the screen; none where the robot does not say it.
function look(said) {
  const right = Number(said["next view right deg"]), up = Number(said["next view up deg"]), turn = Math.round(Math.hypot(right, up));
  document.getElementById("look").hidden = !Number.isFinite(turn);
  document.getElementById("arrow").style.transform = `rotate(${Math.atan2(right, up)}rad)`;
  document.getElementById("turn").textContent = `Turn by ${turn} degrees.`;
}

function frame(now, data) {
  video.requestVideoFrameCallback(frame);
  if (!due(now)) return;
  busy = true;
  last = now;
  const known = Math.abs(now - data.captureTime) < 1000; // some cameras count from another beginning, or not at all
  const width = Math.min(level.width, video.videoWidth);
  const height = Math.round(width * video.videoHeight / video.videoWidth);
  const canvas = new OffscreenCanvas(width, height), pen = canvas.getContext("2d");
  pen.filter = "grayscale(1)";
  pen.drawImage(video, 0, 0, width, height);
  send(canvas, known ? data.captureTime : now, null).finally(() => { busy = false; });
}

async function send(canvas, taken, from) {
  const blob = await canvas.convertToBlob({ type: "image/jpeg", quality: level.quality });
  const jpeg = new Uint8Array(await blob.arrayBuffer());
  const message = new Uint8Array(8 + jpeg.length), t = seconds(taken);
  new DataView(message.buffer).setFloat64(0, t);
  message.set(jpeg, 8);
  if (!socket) return;
  if (from) socket.send(JSON.stringify({ own: [t, ...from] }));
  const turning = rates();
  if (turning.length) socket.send(JSON.stringify({ rates: turning }));
  socket.send(message);
  sent += 1;
}

plain.onclick = start;
tracked.onclick = startTracked;
possible().then((yes) => { trackable = yes; tracked.hidden = !yes || started; });
if (new URLSearchParams(location.hash.slice(1)).has("start")) start();
