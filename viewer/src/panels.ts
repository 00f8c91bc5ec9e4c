// The parts of the viewer beside the picture: players, graphs, events and help.

import { Chart } from "./charts";
import { readNumbers, type Game } from "./data";
import { format, formatTime, make, swatch } from "./elements";

export interface Panel {
  element: HTMLElement;
  recolour(colours: string[]): void;
  moveTo(step: number): void;
}

function recolourAll(marks: HTMLElement[], colours: string[]): void {
  marks.forEach((mark, index) => (mark.style.background = colours[index]));
}

/** What each player owns, does, and how an agent values its actions. */
export async function makePlayers(game: Game): Promise<Panel> {
  const numPlayers = game.players.length;
  const actions = await readNumbers(game.actions.numbers);
  const resources = await Promise.all(
    game.series
      .filter((series) => series.isResource)
      .map(async ({ name, values }) => ({ name, values: await readNumbers(values) })),
  );
  const choices = await Promise.all(
    game.values.map(async (one) => ({
      ...one,
      places: await readNumbers(one.choices),
      numbers: await readNumbers(one.values),
    })),
  );
  const action = game.players.map(() => make("code", {}));
  const owned = game.players.map(() => make("span", { className: "mc-owned" }));
  const valued = game.players.map(() => make("div", { className: "mc-values" }));
  const marks = game.players.map(() => swatch(""));
  const rows = game.players.map((name, seat) => {
    const title = make("span", { className: "mc-name" }, marks[seat], name);
    return make("li", {}, title, action[seat], owned[seat], valued[seat]);
  });
  const showValues = (seat: number, step: number) =>
    choices.flatMap((kind) => {
      const start = (step * numPlayers + seat) * kind.count;
      const numbers = [...kind.numbers.subarray(start, start + kind.count)].filter(Number.isFinite);
      const low = Math.min(0, ...numbers);
      const span = Math.max(1e-9, Math.max(...numbers) - low);
      const bars = numbers.map((number, rank) => {
        const bar = make("meter", { min: 0, max: 1, value: (number - low) / span });
        const text = kind.texts[kind.places[start + rank]];
        bar.setAttribute("aria-label", `${text}: ${format(number)}`);
        return make("div", {}, bar, `${text} ${format(number)}`);
      });
      return bars.length ? [make("small", {}, kind.name), ...bars] : [];
    });
  return {
    element: make("ul", { className: "mc-players", "aria-label": "Players" }, ...rows),
    recolour: (colours) => recolourAll(marks, colours),
    moveTo(step) {
      const isOver = step >= game.steps;
      for (let seat = 0; seat < numPlayers; seat++) {
        const number = actions[step * numPlayers + seat];
        action[seat].textContent = isOver ? "-" : game.actions.texts[number];
        owned[seat].textContent = resources
          .map(({ name, values }) => `${name} ${format(values[step * numPlayers + seat])}`)
          .join("  ");
        valued[seat].replaceChildren(...(isOver ? [] : showValues(seat, step)));
      }
    },
  };
}

/** A graph of each measure. */
export async function makeCharts(game: Game, seek: (step: number) => void): Promise<Panel> {
  const charts = await Promise.all(
    game.series.map(
      async ({ name, values }) =>
        new Chart(name, await readNumbers(values), game.players, (share) =>
          seek(share * game.steps),
        ),
    ),
  );
  return {
    element: make("div", { className: "mc-charts" }, ...charts.map((chart) => chart.element)),
    recolour: (colours) => charts.forEach((chart) => chart.recolour(colours)),
    moveTo: (step) => charts.forEach((chart) => chart.moveTo(step)),
  };
}

/** Buttons that jump to the events of the game. */
export function makeEvents(game: Game, seek: (step: number) => void): Panel {
  const marks = game.events.map(() => swatch(""));
  const buttons = game.events.map((event, index) => {
    const time = make("span", {}, formatTime(event.step * game.secondsPerStep));
    const onclick = () => seek(event.step);
    const mark = event.seat === null ? "" : marks[index];
    return make("button", { type: "button", onclick }, time, mark, event.text);
  });
  const items = buttons.map((button) => make("li", {}, button));
  return {
    element: make("ol", { className: "mc-events", "aria-label": "Events" }, ...items),
    recolour(colours) {
      recolourAll(marks, game.events.map(({ seat }) => colours[seat ?? 0]));
    },
    moveTo(step) {
      buttons.forEach((button, index) => {
        button.classList.toggle("mc-past", game.events[index].step <= step);
      });
    },
  };
}

export function makeHelp(keys: readonly { label: string; text: string }[]): HTMLDialogElement {
  const rows = keys.map(({ label, text }) =>
    make("tr", {}, make("th", { scope: "row" }, make("kbd", {}, label)), make("td", {}, text)),
  );
  const close = make("button", { type: "submit" }, "Close");
  const form = make("form", { method: "dialog" }, close);
  const dialog = make("dialog", { className: "mc-help" }, make("h3", {}, "Keys"));
  dialog.append(make("table", {}, ...rows), form);
  return dialog;
}
