// Runs requests: loads the SWF, dispatches input, runs frames, calls the SWF, reads the picture.
"use strict";

const width = Number(settings.width);
const height = Number(settings.height);
const FIRST_TICKS = 2; // Ruffle 0.6 runs the first frame of a SWF in its second tick

let swf = null; // bytes of the file
let player = null;
let mouse = {}; // shownX, shownY: where the game has seen it
const copy = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
copy.imageSmoothingQuality = "medium";

// --- the game ------------------------------------------------------------------------------------

async function load(seed) {
  player?.remove();
  clock.reset(seed);
  mouse = { x: -1, y: -1, shownX: -1, shownY: -1, isDown: false };
  player = window.RufflePlayer.newest().createPlayer();
  player.style.width = `${width}px`;
  player.style.height = `${height}px`;
  document.body.prepend(player);
  await player.ruffle(1).load({
    data: swf,
    swfFileName: "game.swf",
    autoplay: "on",
    unmuteOverlay: "hidden",
    splashScreen: false,
    contextMenu: "off",
    letterbox: "off",
    scale: "exactFit",
    forceScale: true,
    frameRate: Number(settings.fps),
    preferredRenderer: settings.renderer,
    allowScriptAccess: true, // for callbacks; functions of the page need eval, which the CSP forbids
    allowNetworking: "all", // otherwise Ruffle turns off ExternalInterface; the CSP closes the network
    openUrlMode: "deny",
    upgradeToHttps: false,
    warnOnUnsupportedContent: false,
    maxExecutionDuration: 3600,
  });
  player.focus();
  if (isLockstep) {
    raisePanic();
    drawing.follow(canvas());
    for (let tick = 0; tick < FIRST_TICKS; tick++) clock.tick();
  } else {
    for (let frame = 0; frame < 4; frame++) await new Promise(requestAnimationFrame);
  }
}

// All frames but the last are never seen, and this one only in a picture or over VNC.
function runFrames(numFrames, isSeen) {
  for (let left = numFrames - 1; left >= 0; left--) drawing.run(clock.tick, left > 0 || !isSeen);
  if (isSeen) drawing.catchUp(); // where the last frame drew nothing
}

function canvas() {
  return player.shadowRoot.querySelector("canvas");
}

function raisePanic() {
  const panic = player?.shadowRoot.querySelector("#panic");
  if (panic) throw new Error(panic.querySelector("textarea")?.value || panic.textContent);
}

// --- input ---------------------------------------------------------------------------------------

function dispatch(event) {
  if (event.length === 4) {
    const [code, key, keyCode, isDown] = event;
    const type = isDown ? "keydown" : "keyup";
    finishMove();
    window.dispatchEvent(new KeyboardEvent(type, { code, key, keyCode, cancelable: true }));
  } else {
    moveMouse(...event);
  }
}

// Browsers may merge moves in a row, so here too only the last of them reaches the game.
function moveMouse(x, y, isDown) {
  mouse.x = x;
  mouse.y = y;
  if (isDown === mouse.isDown) return;
  finishMove();
  mouse.isDown = isDown;
  point(isDown ? "pointerdown" : "pointerup", 0);
}

function finishMove() {
  if (mouse.x === mouse.shownX && mouse.y === mouse.shownY) return;
  mouse.shownX = mouse.x;
  mouse.shownY = mouse.y;
  point("pointermove", -1);
}

function point(type, button) {
  const place = { clientX: mouse.x, clientY: mouse.y, pointerType: "mouse", pointerId: 1 };
  const flags = { bubbles: true, cancelable: true, composed: true, isPrimary: true };
  const buttons = Number(mouse.isDown);
  const event = new PointerEvent(type, { ...place, ...flags, button, buttons });
  canvas().dispatchEvent(event);
}

// --- output --------------------------------------------------------------------------------------

function call([name, ...values]) {
  return player.ruffle(1).callExternalInterface(name, ...values) ?? null;
}

// RGB bytes of the game, scaled to `columns` x `rows`.
function readPicture([columns, rows]) {
  if (copy.canvas.width !== columns || copy.canvas.height !== rows) {
    copy.canvas.width = columns;
    copy.canvas.height = rows;
    copy.imageSmoothingQuality = "medium";
  }
  copy.drawImage(canvas(), 0, 0, columns, rows);
  const rgba = copy.getImageData(0, 0, columns, rows).data;
  const rgb = new Uint8Array(columns * rows * 3);
  for (let from = 0, to = 0; to < rgb.length; from += 4, to += 3) {
    rgb[to] = rgba[from];
    rgb[to + 1] = rgba[from + 1];
    rgb[to + 2] = rgba[from + 2];
  }
  return rgb;
}

// --- requests ------------------------------------------------------------------------------------

// Returns the reply: the length of a JSON text in 4 bytes, this text, the picture.
async function run(request) {
  const answer = {};
  let picture = new Uint8Array(0);
  try {
    if (request.seed) await load(request.seed);
    else if (request.picture && !request.frames) drawing.catchUp(); // before events change the game
    for (const event of request.events ?? []) dispatch(event);
    finishMove();
    runFrames(request.frames ?? 0, request.picture || settings.rows > 0);
    raisePanic();
    answer.values = (request.calls ?? []).map(call);
    if (request.picture) picture = readPicture(request.picture);
  } catch (error) {
    answer.error = String(error);
  }
  const text = new TextEncoder().encode(JSON.stringify(answer));
  const reply = new Uint8Array(4 + text.length + picture.length);
  new DataView(reply.buffer).setUint32(0, text.length, true);
  reply.set(text, 4);
  reply.set(picture, 4 + text.length);
  return reply;
}

// --- over the page's socket -----------------------------------------------------------------------

function openSocket(firstReply) {
  const folder = location.pathname.slice(0, location.pathname.lastIndexOf("/"));
  const socket = new WebSocket(`ws://${location.host}${folder}/socket`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(firstReply);
  socket.onmessage = async (message) => socket.send(await run(JSON.parse(message.data)));
}

// --- in-band over VNC: requests are typed, replies are drawn --------------------------------------

const RUN_KEY = "Pause";
// Pressed three times: a request is typed, keys that the game holds are pressed again, done.
const TYPE_KEY = "ScrollLock";
const [PLAYING, TYPING, RESTORING] = [0, 1, 2];
let keyMode = PLAYING;
let typed = ""; // hexadecimal digits, a to p
let lastRequest = {};
let numReplies = 0;

function takeKey(event) {
  if (!event.isTrusted) return;
  event.preventDefault(); // the browser's own keys
  const isOurs = event.key === RUN_KEY || event.key === TYPE_KEY;
  if (keyMode === PLAYING && !isOurs && !event.repeat) {
    finishMove();
    return; // the game takes it
  }
  event.stopImmediatePropagation();
  if (event.repeat || event.type === "keyup") return;
  if (event.key === RUN_KEY) {
    run(lastRequest).then(draw);
  } else if (event.key === TYPE_KEY) {
    keyMode = (keyMode + 1) % 3;
    if (keyMode === TYPING) typed = "";
    if (keyMode === RESTORING) lastRequest = JSON.parse(decode(typed));
  } else if (keyMode === TYPING) {
    typed += event.key;
  }
}

// The game gets the same mouse events as over the socket. Below the game the mouse is parked.
function takeMouse(event) {
  if (!event.isTrusted) return;
  event.stopImmediatePropagation();
  if (event.clientX >= width || event.clientY >= height) return;
  if (["pointermove", "pointerdown", "pointerup"].includes(event.type)) {
    moveMouse(event.clientX, event.clientY, (event.buttons & 1) === 1);
  }
}

function decode(digits) {
  const bytes = new Uint8Array(digits.length / 2);
  const value = (index) => digits.charCodeAt(index) - "a".charCodeAt(0);
  for (let index = 0; index < bytes.length; index++) {
    bytes[index] = 16 * value(2 * index) + value(2 * index + 1);
  }
  return new TextDecoder().decode(bytes);
}

function adler32(bytes) {
  let [low, high] = [1, 0];
  for (const byte of bytes) {
    low = (low + byte) % 65521;
    high = (high + low) % 65521;
  }
  return high * 65536 + low;
}

// Three bytes in a pixel, below the game: "FLSH", number, checksum, length, the reply.
function draw(reply) {
  numReplies += 1;
  const bytes = new Uint8Array(16 + reply.length);
  const head = new DataView(bytes.buffer);
  [0x48534c46, numReplies, adler32(reply), reply.length].forEach((word, index) => {
    head.setUint32(4 * index, word, true);
  });
  bytes.set(reply, 16);
  const pixels = new ImageData(width, Math.ceil(bytes.length / (3 * width)));
  pixels.data.fill(255);
  for (let from = 0, to = 0; from < bytes.length; from += 3, to += 4) {
    pixels.data[to] = bytes[from];
    pixels.data[to + 1] = bytes[from + 1];
    pixels.data[to + 2] = bytes[from + 2];
  }
  strip.putImageData(pixels, 0, 0);
}

function makeStrip() {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = Number(settings.rows);
  canvas.style.top = `${height}px`;
  document.body.append(canvas);
  return canvas.getContext("2d", { alpha: false });
}

// -------------------------------------------------------------------------------------------------

let strip = null;

function startInBand() {
  strip = makeStrip();
  const capture = { capture: true };
  for (const type of ["keydown", "keyup"]) window.addEventListener(type, takeKey, capture);
  for (const name of ["move", "down", "up", "over", "out", "enter", "leave", "cancel"]) {
    window.addEventListener(`pointer${name}`, takeMouse, capture);
  }
}

// The first reply tells how loading went. The socket is open in any case: its end is the page's.
async function start() {
  if (settings.rows > 0) startInBand();
  swf = new Uint8Array(await (await fetch("game.swf")).arrayBuffer());
  openSocket(await run({ seed: [0, 0] }));
}

start();
