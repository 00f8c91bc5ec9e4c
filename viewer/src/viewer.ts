// Puts a recorded game on the page: picture, controls, keys and panels around one playback.

import type { Game, View } from "./data";
import { formatTime, icon, make } from "./elements";
import { makeCharts, makeEvents, makeHelp, makePlayers } from "./panels";
import { Pictures, Screen } from "./pictures";
import { Playback, SPEEDS } from "./playback";

interface Key {
  keys: string[];
  label: string;
  text: string;
  press(event: KeyboardEvent): void;
}

const MANY_STEPS = 10;

/** Fills `root` with the viewer of a game. `alone`: its keys work wherever the focus is. */
export async function mount(root: HTMLElement, game: Game, alone = true): Promise<void> {
  const unpacked = new Map<number, Promise<Pictures>>();
  const unpack = (view: View) => {
    const known = unpacked.get(view.pictures);
    const pictures = known ?? Pictures.unpack(game.pictures[view.pictures]);
    unpacked.set(view.pictures, pictures);
    return pictures;
  };
  let view = game.views[0];
  let pictures = await unpack(view);

  const canvas = make("canvas", { className: "mc-picture", role: "img" });
  const screen = new Screen(canvas);
  const show = () => {
    const { step, isPlaying, speed } = playback;
    const isLast = step === game.steps;
    screen.draw(pictures, isLast ? pictures.count - 1 : Math.floor(step / game.every));
    canvas.setAttribute("aria-label", `${nameView(game, view)}, step ${step}`);
    const seconds = formatTime(step * game.secondsPerStep);
    slider.value = String(step);
    slider.setAttribute("aria-valuetext", `step ${step} of ${game.steps}, ${seconds}`);
    slider.style.setProperty("--mc-done", `${(100 * step) / Math.max(1, game.steps)}%`);
    clock.textContent = `${seconds} · step ${step} / ${game.steps}`;
    const label = isPlaying ? "Pause" : "Play";
    if (play.ariaLabel !== label) {
      play.replaceChildren(icon(isPlaying ? "pause" : "play"));
      play.ariaLabel = play.title = label;
    }
    speeds.value = String(speed);
    panels.forEach((panel) => panel.moveTo(step));
  };
  const playback = new Playback(game.steps, game.fps, () => show());

  const seek = (step: number) => playback.seek(step);
  const players = await makePlayers(game);
  const charts = await makeCharts(game, seek);
  const events = makeEvents(game, seek);
  const panels = [players, charts, events];

  const choose = async (index: number) => {
    if (!game.views[index]) return;
    const chosen = game.views[index];
    const found = await unpack(chosen);
    [view, pictures] = [chosen, found];
    views.value = String(index);
    panels.forEach((panel) => panel.recolour(view.colours));
    show();
  };
  const jump = (direction: number) => {
    const steps = game.events.map((event) => event.step);
    const ahead = steps.filter((step) => (step - playback.step) * direction > 0);
    if (ahead.length) seek(direction > 0 ? Math.min(...ahead) : Math.max(...ahead));
  };
  const keys = listKeys(playback, jump, choose, () => {
    if (help.open) help.close();
    else help.showModal();
  });
  const help = makeHelp(keys);

  const play = makeButton(icon("play"), "Play", () => playback.toggle());
  const slider = make("input", { type: "range", min: "0", max: String(game.steps), step: "1" });
  slider.setAttribute("aria-label", "Step");
  slider.addEventListener("input", () => seek(Number(slider.value)));
  const marks = game.events.map(({ step, text }) => {
    const mark = make("i", { title: text, "aria-hidden": "true" });
    mark.style.left = `${(100 * step) / Math.max(1, game.steps)}%`;
    return mark;
  });
  const line = make("div", { className: "mc-line" }, slider, make("div", {}, ...marks));
  const clock = make("output", { className: "mc-clock" });
  const speeds = makeSelect("Speed", SPEEDS.map((speed) => `${speed}×`), (index) =>
    playback.setSpeed(index),
  );
  const names = game.views.map((one) => nameView(game, one));
  const views = makeSelect("View", names, (index) => void choose(index));
  const bar = make(
    "div",
    { className: "mc-bar", role: "group", "aria-label": "Playback" },
    makeButton(icon("start"), "To the start", () => seek(0)),
    makeButton(icon("back"), "Step back", () => playback.move(-1)),
    play,
    makeButton(icon("forward"), "Step forward", () => playback.move(1)),
    makeButton(icon("end"), "To the end", () => seek(game.steps)),
    speeds,
    views,
    makeButton("?", "Keys", () => help.showModal()),
  );
  const stage = make("div", { className: "mc-stage" }, canvas, line, clock, bar);
  const side = make("div", { className: "mc-side" }, players.element, events.element);
  const body = make("div", { className: "mc-body" }, stage, side, charts.element);
  const note = game.numLeftOut ? ` ${game.numLeftOut} more views would make the file too large.` : "";
  // Enlarged pixels stay squares; a picture that is made smaller is smooth.
  new ResizeObserver(() => {
    const isSmaller = canvas.clientWidth * devicePixelRatio < canvas.width;
    canvas.style.imageRendering = isSmaller ? "auto" : "pixelated";
  }).observe(canvas);
  root.append(body, make("p", { className: "mc-note" }, `${game.title}, ${game.rules}.${note}`), help);
  root.classList.add("mc-viewer");
  root.tabIndex = -1;
  root.setAttribute("role", "group");
  root.setAttribute("aria-label", `Replay: ${game.players.join(" v ")}`);
  (alone ? document : root).addEventListener("keydown", (event) => {
    handleKey(event as KeyboardEvent, keys, help);
  });
  await choose(0);
}

function nameView(game: Game, view: View): string {
  return view.seat === null ? "Everything" : `View of ${game.players[view.seat]}`;
}

function listKeys(
  playback: Playback,
  jump: (direction: number) => void,
  choose: (view: number) => Promise<void>,
  help: () => void,
): Key[] {
  const move = (event: KeyboardEvent, steps: number) =>
    playback.move(event.shiftKey ? MANY_STEPS * steps : steps);
  return [
    { keys: [" ", "k"], label: "Space", text: "Play or pause", press: () => playback.toggle() },
    { keys: ["ArrowLeft"], label: "←", text: "Step back (Shift: ten)", press: (e) => move(e, -1) },
    { keys: ["ArrowRight"], label: "→", text: "Step forward (Shift: ten)", press: (e) => move(e, 1) },
    { keys: ["Home"], label: "Home", text: "To the start", press: () => playback.seek(0) },
    { keys: ["End"], label: "End", text: "To the end", press: () => playback.seek(playback.steps) },
    { keys: ["p"], label: "P", text: "Event before", press: () => jump(-1) },
    { keys: ["n"], label: "N", text: "Next event", press: () => jump(1) },
    { keys: ["-"], label: "-", text: "Slower", press: () => playback.setSpeed(playback.speed - 1) },
    {
      keys: ["+", "="],
      label: "+",
      text: "Faster",
      press: () => playback.setSpeed(playback.speed + 1),
    },
    {
      keys: [..."123456789"],
      label: "1-9",
      text: "View: everything, then each seat",
      press: (event) => void choose(Number(event.key) - 1),
    },
    { keys: ["?"], label: "?", text: "These keys", press: help },
  ];
}

function handleKey(event: KeyboardEvent, keys: Key[], help: HTMLDialogElement): void {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = event.target as HTMLElement;
  const isList = target instanceof HTMLSelectElement; // letters and arrows choose in it
  const isPressed = target instanceof HTMLButtonElement && event.key === " ";
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const key = keys.find((one) => one.keys.includes(name));
  if (!key || isList || isPressed || (help.open && event.key !== "?")) return;
  event.preventDefault();
  key.press(event);
}

function makeButton(face: Node | string, label: string, onclick: () => void): HTMLButtonElement {
  return make("button", { type: "button", ariaLabel: label, title: label, onclick }, face);
}

function makeSelect(
  label: string,
  names: string[],
  choose: (index: number) => void,
): HTMLSelectElement {
  const options = names.map((name, index) => make("option", { value: String(index) }, name));
  const select = make("select", { "aria-label": label, title: label }, ...options);
  select.addEventListener("change", () => choose(Number(select.value)));
  return select;
}
