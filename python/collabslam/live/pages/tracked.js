// A phone that tracks itself (WebXR with camera-access): each image with the pose from which it was taken.

export const possible = async () => {
  try { return !!navigator.xr && typeof XRWebGLBinding !== "undefined" && await navigator.xr.isSessionSupported("immersive-ar"); }
  catch { return false; }
};

// The camera's picture drawn small, upright, first row first: camera textures are opaque, but can be sampled.
const VERTEX = `#version 300 es
in vec2 at; out vec2 uv;
void main() { uv = vec2(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y); gl_Position = vec4(at, 0.0, 1.0); }`;
const FRAGMENT = `#version 300 es
precision mediump float; uniform sampler2D picture; in vec2 uv; out vec4 grey;
void main() { float y = dot(texture(picture, uv).rgb, vec3(0.299, 0.587, 0.114)); grey = vec4(y, y, y, 1.0); }`;

function shader(gl, kind, text) {
  const made = gl.createShader(kind);
  gl.shaderSource(made, text);
  gl.compileShader(made);
  return made;
}

export class Reader {
  constructor(gl) {
    this.gl = gl;
    this.program = gl.createProgram();
    gl.attachShader(this.program, shader(gl, gl.VERTEX_SHADER, VERTEX));
    gl.attachShader(this.program, shader(gl, gl.FRAGMENT_SHADER, FRAGMENT));
    gl.bindAttribLocation(this.program, 0, "at");
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error("the picture cannot be read from this phone's graphics");
    this.corners = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    this.target = gl.createTexture();
    this.frame = gl.createFramebuffer();
    this.size = [0, 0];
  }

  read(texture, width, height) {
    const gl = this.gl, before = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    if (this.size[0] !== width || this.size[1] !== height) {
      gl.bindTexture(gl.TEXTURE_2D, this.target);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.target, 0);
      this.size = [width, height];
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.viewport(0, 0, width, height);
    gl.useProgram(this.program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.corners);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    const data = new Uint8ClampedArray(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);
    gl.bindFramebuffer(gl.FRAMEBUFFER, before);
    return new ImageData(data, width, height);
  }
}

// fx, fy, cx, cy of a picture of so many pixels, whose first pixel's middle is 0, from the view's projection.
export function intrinsics(p, width, height) {
  return [p[0] * width / 2, p[5] * height / 2, (1 - p[8]) * width / 2 - 0.5, (1 + p[9]) * height / 2 - 0.5];
}

// Calls shot(time in ms, view's camera, its calibration, pose [x y z qx qy qz qw], read(width, height)) for each frame.
export async function track(root, shot, lost, ended) {
  const session = await navigator.xr.requestSession("immersive-ar", {
    requiredFeatures: ["camera-access", "local"], optionalFeatures: ["dom-overlay"], domOverlay: { root },
  });
  try {
    const gl = document.createElement("canvas").getContext("webgl2", { xrCompatible: true });
    if (!gl) throw new Error("the browser has no WebGL 2");
    await session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl) });
    const binding = new XRWebGLBinding(session, gl), reader = new Reader(gl);
    const space = await session.requestReferenceSpace("local");
    space.addEventListener("reset", () => session.end()); // another world from here on
    session.addEventListener("end", ended);
    const frame = (time, now) => {
      session.requestAnimationFrame(frame);
      const pose = now.getViewerPose(space), view = pose && pose.views.find((v) => v.camera);
      if (!view || pose.emulatedPosition) { lost(); return; }
      const { position: x, orientation: q } = view.transform;
      const { width, height } = view.camera;
      const from = [x.x, x.y, x.z, q.x, q.y, q.z, q.w];
      shot(time, { width, height, intrinsics: intrinsics(view.projectionMatrix, width, height) }, from,
        (w, h) => reader.read(binding.getCameraImage(view.camera), w, h));
    };
    session.requestAnimationFrame(frame);
  } catch (error) { await session.end(); throw error; }
}
