// How the phone turns while it films: its gyroscope's rates along the axes of the camera on its back, as the browser gives them.
const MOST = 25, FASTEST = 0.008; // samples that wait for an image, and seconds between two of them
const waiting = [];
let last = -Infinity;

// Asks the browser, which some allow only where a button was pressed; whether there are rates is seen when they come.
export async function listen() {
  if (typeof DeviceMotionEvent === "undefined") return;
  if (DeviceMotionEvent.requestPermission) {
    const said = await DeviceMotionEvent.requestPermission().catch(() => "denied");
    if (said !== "granted") return;
  }
  addEventListener("devicemotion", take);
}

// Radians a second along x right, y down, z ahead of the picture, from degrees about the phone's own x right, y up, z out of its screen.
export function along(rate, angle) {
  const unit = Math.PI / 180, turned = angle * unit, c = Math.cos(turned), s = Math.sin(turned);
  const x = rate.beta * unit, y = rate.gamma * unit, z = rate.alpha * unit;
  return [c * x - s * y, -(s * x + c * y), -z];
}

function take(event) {
  const rate = event.rotationRate, t = (performance.timeOrigin + event.timeStamp) / 1000;
  const whole = rate && [rate.alpha, rate.beta, rate.gamma].every((v) => typeof v === "number" && Number.isFinite(v));
  // Held otherwise the rows of the picture are not those that the shutter takes one after the other.
  if (!whole || screen.orientation?.type !== "landscape-primary" || t - last < FASTEST) return;
  last = t;
  waiting.push([t, ...along(rate, screen.orientation.angle)]);
  if (waiting.length > MOST) waiting.shift();
}

// What has come since the last image was sent.
export function rates() {
  return waiting.splice(0);
}
