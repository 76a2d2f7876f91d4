// What WebXR gives to a page on a phone, as far as the phone's page uses it: pictures and poses in turn.
{
  const facts = FACTS;
  const played = { read: 0, away: false };
  window.played = played;
  const bitmaps = Promise.all(facts.shots.map(({ jpeg }) => {
    const bytes = Uint8Array.from(atob(jpeg), (c) => c.charCodeAt(0));
    return createImageBitmap(new Blob([bytes], { type: "image/jpeg" }), { imageOrientation: "flipY" });
  }));
  // The first shot until the phone looks away; then the others, which do not show the tag.
  const number = () => (played.away ? 1 + (played.read % (facts.shots.length - 1)) : 0);

  class Session extends EventTarget {
    async updateRenderState() { this.pictures = await bitmaps; }
    async requestReferenceSpace() { return new EventTarget(); }
    requestAnimationFrame(take) {
      requestAnimationFrame((time) => {
        const { place: [x, y, z], turn: [qx, qy, qz, qw] } = facts.shots[number()];
        const view = {
          camera: { width: facts.width, height: facts.height },
          projectionMatrix: new Float32Array(facts.projection),
          transform: { position: { x, y, z, w: 1 }, orientation: { x: qx, y: qy, z: qz, w: qw } },
        };
        take(time, { getViewerPose: () => ({ views: [view], emulatedPosition: false }) });
      });
    }
    async end() { this.dispatchEvent(new Event("end")); }
  }

  window.XRWebGLLayer = class { };
  window.XRWebGLBinding = class {
    constructor(session, gl) { this.session = session; this.gl = gl; this.texture = gl.createTexture(); }
    getCameraImage() {
      const gl = this.gl;
      gl.bindTexture(gl.TEXTURE_2D, this.texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, this.session.pictures[number()]);
      played.read += 1;
      return this.texture;
    }
  };
  const xr = {
    isSessionSupported: async (mode) => mode === "immersive-ar",
    requestSession: async () => {
      if (facts.refuse) throw new Error(facts.refuse);
      return new Session();
    },
  };
  Object.defineProperty(navigator, "xr", { value: xr, configurable: true });
}
