// The page: a person plays one seat, the opponent the others, on rules that equal Python's.

import { inflate } from "../src/data";
import { Controls } from "./controls.js";
import { loadOpponent } from "./opponents.js";
import { makeReplay } from "./replay_file.js";
import { Rules } from "./rules.js";

const find = (id) => document.getElementById(id);
const wanted = new URLSearchParams(location.search);
const NO_WINNER = -1;
const isFramed = parent !== globalThis; // in another page
const HIGHEST = isFramed ? Infinity : 0.74; // share of the window's height that the board may take

class Play {
  static async load() {
    const { game, files } = JSON.parse(find("game").textContent);
    const readFile = (name) => inflate(files[name]);
    const rules = await Rules.load(await readFile("rules.wasm"));
    return new Play(game, rules, await loadOpponent(rules, game.opponent, readFile));
  }

  constructor(game, rules, opponent) {
    Object.assign(this, { game, rules, opponent });
    this.seat = Math.min(Number(wanted.get("seat") ?? 0), rules.numPlayers - 1);
    this.others = [...Array(rules.numPlayers).keys()].filter((seat) => seat !== this.seat);
    this.speed = Number(wanted.get("speed") ?? find("speed").value);
    find("speed").value = String(this.speed);
    const canvas = find("board");
    [canvas.height, canvas.width] = rules.shapes.picture.slice(-2);
    this.context = canvas.getContext("2d", { willReadFrequently: true });
    this.image = this.context.createImageData(canvas.width, canvas.height);
    this.image.data.fill(255);
    this.controls = new Controls(game, find("orders"), say, () => this.paint());
    this.isPaused = true;
    this.hasBegun = false;
    this.seedNext = wanted.get("seed");
    this.listen(canvas);
    this.begin();
  }

  // --- one game ------------------------------------------------------------------------------

  begin() {
    this.seed = this.seedNext ?? String(crypto.getRandomValues(new Uint32Array(1))[0]);
    this.seedNext = null;
    this.rules.reset(this.seed);
    this.opponent.restart(this.seed);
    this.controls.queue.length = 0;
    this.played = []; // actions of all seats, step by step
    this.score = 0;
    this.actions = null; // of the step that is shown
    this.show();
  }

  async decide() {
    const mask = this.rules.legalActions(this.seat).slice();
    const own = this.controls.next(mask);
    const chosen = await this.opponent.decide(this.others);
    const actions = new Int32Array(this.rules.numPlayers);
    actions[this.seat] = own;
    this.others.forEach((seat, index) => { actions[seat] = chosen[index]; });
    return actions;
  }

  finishStep() {
    this.rules.step(this.actions);
    this.played.push(Array.from(this.actions));
    this.actions = null;
    this.score += this.rules.arrays.rewards[this.seat];
    this.show();
    if (this.rules.isOver) this.end();
  }

  // Choose the actions of the next step, once for all that wait for them.
  prepare() {
    this.preparing ??= this.decide().then((actions) => {
      this.actions = actions;
      this.shownTicks = 0;
      this.preparing = null;
    });
    return this.preparing;
  }

  async stepOnce() {
    while (!this.actions) {
      if (this.rules.isOver) return;
      await this.prepare();
    }
    this.finishStep();
  }

  async end() {
    this.isPaused = true;
    this.hasBegun = false;
    this.hash = await this.rules.hash();
    const names = Array(this.rules.numPlayers).fill(this.game.opponent.name);
    names[this.seat] = "person";
    const { winner } = this.rules;
    const file = makeReplay(this.game, this.seed, names, this.played, this.hash, winner);
    find("save").href = URL.createObjectURL(file);
    find("save").download = `${this.game.name}-${this.seed}.replay`;
    find("result").textContent = this.describeResult();
    find("about").textContent = `${this.played.length} steps, seed ${this.seed}. State: ${this.hash.slice(0, 16)}`;
    find("start").textContent = "Play again";
    find("save").hidden = false;
    find("cover").hidden = false;
    find("start").focus();
  }

  describeResult() {
    const { winner } = this.rules, { team_of_seat: teams } = this.game;
    if (new Set(teams).size < 2) return `Score ${format(this.score)}`;
    if (winner === NO_WINNER) return "Draw";
    return teams[winner] === teams[this.seat] ? "You win" : "You lose";
  }

  // --- time ----------------------------------------------------------------------------------

  run() {
    let before = performance.now(), passed = 0;
    const turn = async (now) => {
      passed += Math.min(now - before, 250) * this.speed;
      before = now;
      if (this.isPaused) passed = 0;
      else passed = await this.advance(passed);
      requestAnimationFrame(turn);
    };
    requestAnimationFrame(turn);
  }

  // Play the steps of `passed` milliseconds; returns those that are left.
  async advance(passed) {
    const whole = 1000 * this.game.seconds_per_step, { ticks } = this.game;
    while (!this.isPaused) {
      if (!this.actions) {
        await this.prepare();
        continue;
      }
      if (passed < whole) break;
      passed -= whole;
      this.finishStep();
    }
    const tick = Math.floor((passed / whole) * ticks);
    if (this.actions && this.game.has_look && tick > 0 && tick < ticks && tick !== this.shownTicks) {
      this.shownTicks = tick;
      this.draw(...this.rules.glimpse(this.actions, tick, this.seat));
    }
    return passed;
  }

  setPaused(isPaused) {
    if (!this.hasBegun) return;
    this.isPaused = isPaused;
    find("pause").textContent = isPaused ? "Go on" : "Pause";
  }

  // --- what is shown -------------------------------------------------------------------------

  show() {
    this.draw(...this.rules.observeBoard(this.seat));
    this.controls.showLegal(this.rules.legalActions(this.seat).slice());
    this.paint();
    find("steps").textContent = `${this.played.length} of ${this.game.max_steps}`;
    find("score").textContent = format(this.score);
  }

  // picture: uint8 [3, height, width]; numbers: of the same moment, for the table.
  draw(picture, numbers) {
    const { data } = this.image, size = picture.length / 3;
    for (let pixel = 0; pixel < size; pixel++) {
      data[4 * pixel] = picture[pixel];
      data[4 * pixel + 1] = picture[size + pixel];
      data[4 * pixel + 2] = picture[2 * size + pixel];
    }
    for (const { own, enemy, cells } of this.numbers ??= makeNumbers(this.game)) {
      cells[0].textContent = format(numbers[own]);
      if (cells[1]) cells[1].textContent = format(numbers[enemy]);
    }
    this.paint();
  }

  paint() {
    this.context.putImageData(this.image, 0, 0);
    this.controls?.paint(this.context);
  }

  // --- events --------------------------------------------------------------------------------

  start() {
    if (this.rules.isOver) this.begin();
    this.hasBegun = true;
    find("cover").hidden = true;
    this.setPaused(false);
    find("board").focus();
  }

  listen(canvas) {
    new ResizeObserver(() => fit(canvas)).observe(find("stage"));
    addEventListener("resize", () => fit(canvas)); // another height, or another screen
    find("start").addEventListener("click", () => this.start());
    find("pause").addEventListener("click", () => this.setPaused(!this.isPaused));
    find("one").addEventListener("click", () => this.single());
    find("speed").addEventListener("change", (event) => { this.speed = Number(event.target.value); });
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      const across = canvas.width / box.width, down = canvas.height / box.height;
      return [(event.clientX - box.left) * across, (event.clientY - box.top) * down];
    };
    canvas.addEventListener("pointermove", (event) => this.controls.point(...place(event)));
    canvas.addEventListener("pointerdown", (event) => {
      this.controls.point(...place(event));
      this.controls.click(...place(event), event.button);
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("keydown", (event) => this.press(event));
    addEventListener("keyup", (event) => this.controls.release(event));
    addEventListener("blur", () => this.controls.held.clear());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.setPaused(true); });
  }

  single() {
    if (!this.hasBegun) return;
    this.setPaused(true);
    this.stepOnce();
  }

  press(event) {
    if (!this.hasBegun || event.ctrlKey || event.metaKey || event.altKey) return;
    const onControl = event.target instanceof HTMLElement && event.target.closest("button, select, a");
    if (onControl && [" ", "Enter"].includes(event.key)) return;
    if (event.key === "p") this.setPaused(!this.isPaused);
    else if (event.key === "n") this.single();
    else if (!this.controls.press(event)) return;
    event.preventDefault();
  }
}

// Enlarge the board by a whole number of the screen's pixels, or to its own size where that is
// larger; it is smooth where its pixels cannot be equal squares.
function fit(canvas) {
  const across = find("stage").clientWidth / canvas.width;
  const room = Math.min(across, (HIGHEST * innerHeight) / canvas.height) * devicePixelRatio;
  const times = Math.max(Math.floor(room), Math.min(room, devicePixelRatio));
  canvas.style.width = `${(times * canvas.width) / devicePixelRatio}px`;
  canvas.style.imageRendering = Number.isInteger(times) ? "pixelated" : "auto";
}

function say(text) {
  find("message").textContent = text;
}

// 3 -> "3", 0.25 -> "0.25", -0 -> "0".
function format(number) {
  return String(Math.round((number + Number.EPSILON) * 100) / 100 || 0);
}

function makeNumbers(game) {
  return game.numbers.map(({ label, own, enemy }) => {
    const row = document.createElement("tr");
    const cells = [own, enemy].filter((index) => index !== null)
      .map(() => document.createElement("td"));
    const head = Object.assign(document.createElement("th"), { scope: "row", textContent: label });
    row.append(head, ...cells);
    find("numbers").append(row);
    return { own, enemy, cells };
  });
}

function describeGame(game) {
  document.title = `${game.title}: play`;
  find("title").textContent = game.title;
  find("summary").textContent = game.summary;
  find("opponent").textContent = game.opponent.name;
  if (game.team_of_seat.length < 2) {
    for (const part of [find("opponent"), find("opponent").previousElementSibling]) part.hidden = true;
  }
  find("scenario").textContent = game.scenario;
  find("pays").textContent = game.pays;
  find("sides").hidden = !game.numbers.some(({ enemy }) => enemy !== null);
}

// The page around this one gives its frame this height, so that nothing in it scrolls.
function reportHeight() {
  const page = document.querySelector("main");
  document.documentElement.classList.add("framed");
  new ResizeObserver(() => {
    parent.postMessage({ height: Math.ceil(page.getBoundingClientRect().height) }, "*");
  }).observe(page);
}

async function main() {
  if (isFramed) reportHeight();
  const play = await Play.load();
  describeGame(play.game);
  play.run();
  find("result").textContent = "Ready?";
  find("about").textContent = "Your orders take effect at the next step.";
  find("start").disabled = false;
  find("start").textContent = "Start";
  globalThis.play = play;
  if (wanted.has("autostart")) play.start();
}

main().catch((error) => {
  find("result").textContent = "This game cannot be played here";
  find("about").textContent = `${error.message}. The page needs a browser of 2023 or later, with WebAssembly.`;
  find("start").hidden = true;
  throw error;
});
