// Makes elements of the page.

type Child = Node | string;

export function make<Name extends keyof HTMLElementTagNameMap>(
  name: Name,
  properties: Record<string, unknown> = {},
  ...children: Child[]
): HTMLElementTagNameMap[Name] {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key in element) Reflect.set(element, key, value);
    else element.setAttribute(key, String(value));
  }
  element.append(...children);
  return element;
}

export function swatch(colour: string): HTMLElement {
  const element = make("i", { className: "mc-swatch", "aria-hidden": "true" });
  element.style.background = colour;
  return element;
}

/** Short text of a number: 1234567 is 1.23M. */
export function format(value: number): string {
  const size = Math.abs(value);
  if (size >= 1e6) return `${(value / 1e6).toPrecision(3)}M`;
  if (size >= 1e5) return `${Math.round(value / 1e3)}k`;
  return Number.isInteger(value) ? String(value) : String(+value.toPrecision(3));
}

export function formatTime(seconds: number): string {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

// Shapes in a square of 16, for buttons: not every font has these signs.
const SHAPES = {
  play: "M4 2v12l10-6z",
  pause: "M3 2h4v12H3zm6 0h4v12H9z",
  back: "M11 2v12L3 8z",
  forward: "M5 2v12l8-6z",
  start: "M2 2h2v12H2zm12 0v12L5 8z",
  end: "M12 2h2v12h-2zM2 2v12l9-6z",
};

export function icon(name: keyof typeof SHAPES): SVGElement {
  const space = "http://www.w3.org/2000/svg";
  const drawing = document.createElementNS(space, "svg");
  const path = document.createElementNS(space, "path");
  path.setAttribute("d", SHAPES[name]);
  drawing.setAttribute("viewBox", "0 0 16 16");
  drawing.setAttribute("aria-hidden", "true");
  drawing.append(path);
  return drawing;
}
