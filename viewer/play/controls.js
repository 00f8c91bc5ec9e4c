// What a person orders: buttons and keys for kinds of action, cells of the board, and a queue.

const NO_CELL = -1;
const ARROWS = ["up", "down", "left", "right"];
const DIGITS = "123456789";
const LETTERS = "qwertyuioasdfghjklzxcvbm"; // without p and n: pause and one step

// The keys of kinds of action, by their names: arrows for ways, space for flapping, else 1, 2, ...
function chooseKeys(names) {
  const keys = new Map(), free = [...DIGITS, ...LETTERS];
  for (const name of names) {
    const way = name.split("_").at(-1);
    if (name === "flap") keys.set(name, " ");
    else if (ARROWS.includes(way) && name.split("_").length <= 2) keys.set(name, `Arrow${way[0].toUpperCase()}${way.slice(1)}`);
    else if (name !== "noop") keys.set(name, free.shift() ?? "");
  }
  return keys;
}

const KEY_NAMES = { ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→", " ": "space" };

export class Controls {
  // game: the entry of the page. say: shows a message. redraw: paints the board again.
  constructor(game, bar, say, redraw) {
    Object.assign(this, { say, redraw, actions: game.actions, board: game.board });
    const { groups, group_names, cells } = this.actions;
    this.kinds = group_names.map((name, index) => {
      const members = [];
      groups.forEach((group, action) => { if (group === index) members.push(action); });
      return { name, members, hasCells: cells[members[0]] !== NO_CELL };
    });
    this.keys = chooseKeys(group_names);
    this.pointer = game.pointer;
    this.longest = game.seconds_per_step >= 0.5 ? 6 : 2;
    this.queue = [];
    this.held = new Set();
    this.tool = null; // the chosen kind of action that needs a cell
    this.cell = null; // under the pointer, or chosen by keys
    this.mask = null;
    this.buttons = this.kinds.map((kind) => this.addButton(kind, bar));
  }

  addButton(kind, bar) {
    if (kind.members[0] === this.actions.noop) return null;
    const button = document.createElement("button");
    button.type = "button";
    const key = this.keys.get(kind.name);
    const shown = KEY_NAMES[key] ?? key;
    button.innerHTML = "<span><span></span> <small></small></span><kbd></kbd>";
    const [name, price] = button.firstChild.children;
    name.textContent = kind.name.replaceAll("_", " ");
    price.textContent = (this.actions.prices[kind.name] ?? "").replace(/(\d) /g, "$1\u00a0");
    button.lastChild.textContent = shown;
    if (kind.hasCells) button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => this.choose(kind));
    bar.append(button);
    return button;
  }

  // Take a kind of action as the tool, or order it where it needs no cell.
  choose(kind) {
    if (!kind.hasCells) { this.order(kind.members[0], kind.name); return; }
    this.tool = this.tool === kind ? null : kind;
    if (this.tool && this.cell === null) this.cell = this.firstLegalCell();
    this.say(this.tool ? `${kind.name.replaceAll("_", " ")}: choose a cell` : "");
    this.showTool();
  }

  showTool() {
    this.buttons.forEach((button, index) => {
      const kind = this.kinds[index];
      if (button && kind.hasCells) button.setAttribute("aria-pressed", String(kind === this.tool));
    });
    this.redraw();
  }

  firstLegalCell() {
    const legal = this.tool.members.find((action) => this.mask?.[action]);
    return this.actions.cells[legal ?? this.tool.members[0]];
  }

  // The action of a kind at a cell, or undefined.
  actionAt(kind, cell) {
    return kind.members.find((action) => this.actions.cells[action] === cell);
  }

  orderAt(kind, cell) {
    const action = this.actionAt(kind, cell);
    if (action === undefined) this.say(`${kind.name.replaceAll("_", " ")} is not possible there`);
    else this.order(action, kind.name);
  }

  order(action, name) {
    if (this.queue.length >= this.longest) { this.say("too many orders wait: let some be done"); return; }
    this.queue.push({ action, name });
  }

  // The person's action of the next step; illegal orders are dropped with a message.
  next(mask) {
    this.mask = mask;
    while (this.queue.length > 0) {
      const { action, name } = this.queue.shift();
      if (mask[action]) return action;
      this.say(`${name.replaceAll("_", " ")} is not possible now`);
    }
    for (const kind of this.kinds) {
      const key = this.keys.get(kind.name);
      if (this.held.has(key) && !kind.hasCells && mask[kind.members[0]]) return kind.members[0];
    }
    return this.actions.noop;
  }

  // Buttons of kinds without a legal action are dim.
  showLegal(mask) {
    this.mask = mask;
    this.buttons.forEach((button, index) => {
      if (button) button.classList.toggle("dim", !this.kinds[index].members.some((action) => mask[action]));
    });
  }

  // Keys; true where the key was one of ours.
  press(event) {
    const { key } = event;
    if (this.tool && this.board && (key in KEY_NAMES || key === "Enter")) return this.moveCell(key);
    if (key === "Escape" && this.tool) { this.choose(this.tool); return true; }
    const kind = this.kinds.find(({ name }) => this.keys.get(name) === key);
    if (!kind) return false;
    if (key.startsWith("Arrow")) this.held.add(key);
    if (!event.repeat) this.choose(kind);
    return true;
  }

  release(event) {
    this.held.delete(event.key);
  }

  moveCell(key) {
    const { rows, columns } = this.board;
    let row = Math.floor(this.cell / columns), column = this.cell % columns;
    if (key === "Enter" || key === " ") { this.orderAt(this.tool, this.cell); return true; }
    if (key === "ArrowUp") row = Math.max(0, row - 1);
    if (key === "ArrowDown") row = Math.min(rows - 1, row + 1);
    if (key === "ArrowLeft") column = Math.max(0, column - 1);
    if (key === "ArrowRight") column = Math.min(columns - 1, column + 1);
    this.cell = row * columns + column;
    this.redraw();
    return true;
  }

  // The cell at a pixel of the picture, or null.
  findCell(x, y) {
    if (!this.board) return null;
    const { left, top, tile, rows, columns } = this.board;
    const row = Math.floor((y - top) / tile), column = Math.floor((x - left) / tile);
    const isInside = row >= 0 && row < rows && column >= 0 && column < columns;
    return isInside ? row * columns + column : null;
  }

  point(x, y) {
    const cell = this.findCell(x, y);
    if (cell === this.cell) return;
    this.cell = cell;
    if (this.tool) this.redraw();
  }

  // button: 0 left, 2 right.
  click(x, y, button) {
    const cell = this.findCell(x, y), [only, ...more] = this.kinds.filter((_, at) => this.buttons[at]);
    if (!this.board && more.length === 0) this.choose(only); // a tap anywhere flaps
    if (cell === null) return;
    const named = button === 2 ? this.pointer.right : this.pointer.left;
    const kind = button === 0 && this.tool ? this.tool : this.kinds.find(({ name }) => name === named);
    if (kind) this.orderAt(kind, cell);
    else if (button === 0) this.say("first choose what to build");
  }

  // Marks the cells where the tool can be used, and the chosen one.
  paint(context) {
    if (!this.tool || !this.mask || !this.board) return;
    const { left, top, tile, columns } = this.board;
    const box = (cell) => [
      left + (cell % columns) * tile + 1, top + Math.floor(cell / columns) * tile + 1, tile - 2, tile - 2,
    ];
    context.fillStyle = "rgb(255 255 255 / 16%)";
    for (const action of this.tool.members) {
      if (this.mask[action]) context.fillRect(...box(this.actions.cells[action]));
    }
    if (this.cell === null) return;
    const action = this.actionAt(this.tool, this.cell);
    context.lineWidth = 3;
    context.strokeStyle = action !== undefined && this.mask[action] ? "#fff" : "#ff8674";
    context.strokeRect(...box(this.cell));
  }
}
