// Starts the viewer in every element of the page that holds a game.

import type { Game } from "./data";
import style from "./style.css";
import { mount } from "./viewer";

const sheet = document.createElement("style");
sheet.textContent = style;
document.head.append(sheet);

const roots = [...document.querySelectorAll<HTMLElement>(".mc-replay")];
for (const root of roots) {
  const game = JSON.parse(root.querySelector("script")!.textContent!) as Game;
  mount(root, game, roots.length === 1).catch((error: unknown) => {
    root.append(`The game cannot be shown: ${String(error)}`);
    throw error;
  });
}
