// The camera's images as JPEGs with the time of their capture, as many as the robot has use for.
import { connect, facts, say } from "/link.js";

const video = document.getElementById("video");
const seconds = (ms) => (performance.timeOrigin + ms) / 1000;
let socket = null, busy = false, last = -Infinity, sent = 0, asking = null;
const shown = new Set(["link", "started", "metric", "cf matches"]);
let level = { width: 640, quality: 0.5, rate: 10 };

async function start() {
  document.getElementById("start").disabled = true;
  try {
    const wanted = { facingMode: "environment", width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    video.srcObject = await navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
    await video.play();
  } catch (error) {
    document.getElementById("start").disabled = false;
    say(`The camera cannot be used: ${error.message}. Allow it in the browser, and open this page with https.`, false);
    return;
  }
  connect("phone", () => ({ width: video.videoWidth, height: video.videoHeight }), take, () => { socket = null; });
  video.requestVideoFrameCallback(frame);
  if (navigator.wakeLock) navigator.wakeLock.request("screen").catch(() => {});
}

function take(message, from) {
  if (message.refused) { say(message.refused, false); return; }
  if (message.ready) {
    socket = from;
    say("Sending. Look at what the robot sees.", true);
    clearInterval(asking);
    asking = setInterval(() => from.readyState === 1 && from.send(JSON.stringify({ ask: seconds(performance.now()) })), 500);
    from.send(JSON.stringify({ ask: seconds(performance.now()) }));
  }
  if (message.asked !== undefined) {
    const back = seconds(performance.now());
    from.send(JSON.stringify({ exchange: [message.asked, message.received, message.answered, back] }));
  }
  if (message.level) level = message.level;
  if (message.facts) {
    const own = Object.entries(message.facts).filter(([name]) => shown.has(name) || name.includes(":"));
    facts({ "images sent": sent, ...Object.fromEntries(own) });
  }
}

function frame(now, data) {
  video.requestVideoFrameCallback(frame);
  if (!socket || busy || socket.bufferedAmount > 60000 || now - last < 900 / level.rate) return;
  busy = true;
  last = now;
  const known = Math.abs(now - data.captureTime) < 1000; // some cameras count from another beginning, or not at all
  send(known ? data.captureTime : now).finally(() => { busy = false; });
}

async function send(taken) {
  const width = Math.min(level.width, video.videoWidth);
  const height = Math.round(width * video.videoHeight / video.videoWidth);
  const canvas = new OffscreenCanvas(width, height), pen = canvas.getContext("2d");
  pen.filter = "grayscale(1)";
  pen.drawImage(video, 0, 0, width, height);
  const blob = await canvas.convertToBlob({ type: "image/jpeg", quality: level.quality });
  const jpeg = new Uint8Array(await blob.arrayBuffer());
  const message = new Uint8Array(8 + jpeg.length);
  new DataView(message.buffer).setFloat64(0, seconds(taken));
  message.set(jpeg, 8);
  if (socket) { socket.send(message); sent += 1; }
}

document.getElementById("start").onclick = start;
if (new URLSearchParams(location.hash.slice(1)).has("start")) start();
