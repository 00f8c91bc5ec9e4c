// Draws a measure of all players over the steps of the game, with a cursor at the present step.

import { format, make, swatch } from "./elements";

const HEIGHT = 72; // CSS pixels
const EDGE = 4; // above and below the lines

export class Chart {
  readonly element: HTMLElement;
  private readonly canvas = make("canvas", { "aria-hidden": "true" });
  private readonly cursor = make("div", { className: "mc-cursor" });
  private readonly labels: { mark: HTMLElement; number: Text }[];
  private colours: string[] = [];

  constructor(
    name: string,
    private readonly values: Float32Array, // [steps + 1, players]
    private readonly players: string[],
    seek: (share: number) => void,
  ) {
    this.labels = players.map(() => ({ mark: swatch(""), number: new Text() }));
    const plot = make("div", { className: "mc-plot" }, this.canvas, this.cursor);
    const follow = (event: PointerEvent) => {
      const box = plot.getBoundingClientRect();
      seek(Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
    };
    plot.addEventListener("pointerdown", (event) => {
      plot.setPointerCapture(event.pointerId);
      follow(event);
    });
    plot.addEventListener("pointermove", (event) => event.buttons && follow(event));
    const labels = this.labels.map(({ mark, number }, player) =>
      make("span", { title: `${name} of ${players[player]}` }, mark, number),
    );
    const numbers = make("div", { className: "mc-numbers" }, ...labels);
    const caption = make("figcaption", {}, make("b", {}, name), numbers);
    this.element = make("figure", { className: "mc-chart" }, caption, plot);
    new ResizeObserver(() => this.draw()).observe(plot);
  }

  recolour(colours: string[]): void {
    this.colours = colours;
    this.labels.forEach(({ mark }, player) => (mark.style.background = colours[player]));
    this.draw();
  }

  moveTo(step: number): void {
    const numPlayers = this.players.length;
    const last = this.values.length / numPlayers - 1;
    this.cursor.style.left = `${(100 * step) / Math.max(1, last)}%`;
    this.labels.forEach(({ number }, player) => {
      number.data = format(this.values[step * numPlayers + player]);
    });
  }

  draw(): void {
    const scale = devicePixelRatio || 1;
    const width = this.canvas.parentElement!.clientWidth;
    if (!width || !this.colours.length) return;
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(HEIGHT * scale);
    const context = this.canvas.getContext("2d")!;
    context.scale(scale, scale);
    const numPlayers = this.players.length;
    const last = Math.max(1, this.values.length / numPlayers - 1);
    let [low, high] = [0, 0];
    for (const value of this.values) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    const toX = (step: number) => (width * step) / last;
    const toY = (value: number) =>
      HEIGHT - EDGE - ((HEIGHT - 2 * EDGE) * (value - low)) / Math.max(1e-9, high - low);
    const style = getComputedStyle(this.element);
    const stroke = (colour: string, line: number, path: Path2D) => {
      [context.strokeStyle, context.lineWidth] = [colour, line];
      context.stroke(path);
    };
    const ground = new Path2D();
    ground.moveTo(0, toY(0));
    ground.lineTo(width, toY(0));
    stroke(style.getPropertyValue("--line"), 1, ground);
    context.lineJoin = "round";
    for (let player = numPlayers - 1; player >= 0; player--) {
      const path = new Path2D();
      for (let step = 0; step <= last; step++) {
        path.lineTo(toX(step), toY(this.values[step * numPlayers + player]));
      }
      // A rim keeps light players visible on a light page, and dark ones on a dark page.
      stroke(style.getPropertyValue("--rim"), 3, path);
      stroke(this.colours[player], 1.75, path);
    }
    context.fillStyle = style.getPropertyValue("--quiet");
    context.font = "11px system-ui, sans-serif";
    context.fillText(format(high), 2, 12);
  }
}
