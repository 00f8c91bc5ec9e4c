// Leaves out what Ruffle draws in frames that are never seen: drawing is most of a frame's time.
// With "webgl" all is drawn, and kept: browsers clear such canvases once they were shown.
"use strict";

const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (type, attributes) {
  const kept = type.startsWith("webgl") ? { ...attributes, preserveDrawingBuffer: true } : attributes;
  return getContext.call(this, type, kept);
};

const drawing = (() => {
  // What changes the picture of a canvas, by its name among the functions that Ruffle imports.
  const CALLS = "clearRect|clip|drawImage|fill|fillRect|fillText|putImageData|resetTransform|restore";
  const MORE = "save|setTransform|set_\\w+|stroke|transform";
  const DRAWS = new RegExp(`^__wbg_(${CALLS}|${MORE})_[0-9a-f]{16}$`);
  let context = null; // of the game's canvas, where this is drawn by "canvas"
  let isHidden = false; // from now on
  let isStale = false; // the canvas shows an earlier frame

  function follow(canvas) {
    context = settings.renderer === "canvas" ? canvas.getContext("2d") : null;
    isStale = false;
  }

  function wrap(draw) {
    return (target, a, b, c, d, e, f, g, h, i) => {
      if (target === context) {
        isStale = isHidden;
        if (isHidden) return;
      }
      return draw(target, a, b, c, d, e, f, g, h, i);
    };
  }

  function wrapImports(imports) {
    for (const functions of Object.values(imports ?? {})) {
      for (const name of Object.keys(functions)) {
        if (DRAWS.test(name)) functions[name] = wrap(functions[name]);
      }
    }
    return imports;
  }

  for (const name of ["instantiate", "instantiateStreaming"]) {
    const real = WebAssembly[name];
    WebAssembly[name] = (source, imports) => real(source, wrapImports(imports));
  }

  // Runs `frame`; all that it draws is left out if `hides`.
  function run(frame, hides) {
    isHidden = hides;
    try {
      frame();
    } finally {
      isHidden = false;
    }
  }

  // Draws the frame that was left out. Ruffle draws again when the size of a pixel changes.
  function catchUp() {
    if (!isStale) return;
    for (const ratio of [1 + 1e-9, 1]) {
      window.devicePixelRatio = ratio;
      clock.repeat();
    }
  }

  return { follow, run, catchUp };
})();
