// Replaces the page's sources of time and randomness, so that a game can run frame by frame.
"use strict";

const settings = Object.fromEntries(new URLSearchParams(location.search));
const isLockstep = settings.mode === "lockstep";

const clock = (() => {
  const frameTime = 1000 / Number(settings.fps); // milliseconds
  const FIRST_DATE = Date.UTC(2020, 0, 1);
  let words = new Uint32Array(4); // state of the generator sfc32
  let now = 0; // milliseconds since the SWF was loaded
  let date = FIRST_DATE; // at time zero
  let numTicks = 0;
  let waiting = new Map(); // callbacks of requestAnimationFrame by their number
  let lastNumber = 0;

  function nextWord() {
    const sum = (words[0] + words[1] + words[3]) >>> 0;
    words[3] += 1;
    words[0] = words[1] ^ (words[1] >>> 9);
    words[1] = words[2] + (words[2] << 3);
    words[2] = ((words[2] << 21) | (words[2] >>> 11)) + sum;
    return sum;
  }

  // Begins again at time zero. `seed`: two 32-bit numbers. Ruffle seeds the game's Math.random with
  // the date when it is first called, so the date follows from the seed: one from 2020 to 2054.
  function reset(seed) {
    words = Uint32Array.of(seed[0], seed[1], 0x9e3779b9, 1);
    for (let round = 0; round < 15; round++) nextWord();
    now = 0;
    numTicks = 0;
    waiting.clear();
    date = FIRST_DATE + nextWord() * 2 ** 8 + (nextWord() >>> 24);
  }

  // Runs what waits for the next animation frame. All but the first tick are 0.01 ms late: then
  // rounding never makes the time between two ticks too short for one frame of the game.
  function tick() {
    now = numTicks * frameTime + (numTicks > 0 ? 0.01 : 0);
    numTicks += 1;
    repeat();
  }

  // Runs what waits, at the same time once more.
  function repeat() {
    const due = waiting;
    waiting = new Map();
    for (const callback of due.values()) callback(now);
  }

  function replaceRandomness() {
    Math.random = () => nextWord() / 2 ** 32;
    crypto.getRandomValues = (array) => {
      const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
      for (let index = 0; index < bytes.length; index++) bytes[index] = nextWord();
      return array;
    };
  }

  function replaceTime() {
    const RealDate = Date;
    globalThis.Date = class extends RealDate {
      constructor(...parts) {
        super(...(parts.length ? parts : [date + now]));
      }
      static now() {
        return date + now;
      }
    };
    performance.now = () => now;
    window.requestAnimationFrame = (callback) => {
      lastNumber += 1;
      waiting.set(lastNumber, callback);
      return lastNumber;
    };
    window.cancelAnimationFrame = (number) => waiting.delete(number);
    // Sound runs by the clock on the wall: without these, Ruffle plays none.
    delete window.AudioContext;
    delete window.webkitAudioContext;
  }

  // In real time. Displays show frames evenly, 60 a second, but the times that they report vary by
  // 0.1 ms: of a game of 60 frames per second Ruffle would then often run no frame in one of them
  // and two in the next. So times within a millisecond of an even one are made even, and a little
  // longer than the game's, for rounding.
  function steadyTime() {
    const request = window.requestAnimationFrame.bind(window);
    const interval = ((1 + 1e-6) * frameTime) / Math.max(1, Math.round(0.06 * frameTime));
    let last = 0;
    window.requestAnimationFrame = (callback) =>
      request((time) => {
        const even = last + interval * Math.round((time - last) / interval);
        last = Math.abs(even - time) < 1 ? even : time;
        callback(last);
      });
  }

  reset([0, 0]);
  replaceRandomness();
  if (isLockstep) replaceTime();
  else steadyTime();
  return { reset, tick, repeat };
})();
