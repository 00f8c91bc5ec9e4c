// One world of a game: its arrays, and the rules that were compiled from Python to WebAssembly.

const NUMBERS = {
  bool: Uint8Array, int8: Int8Array, int16: Int16Array, int32: Int32Array, int64: BigInt64Array,
  uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array, uint64: BigUint64Array,
  float32: Float32Array, float64: Float64Array,
};
const NOTE = "marl_cair"; // the module's section that lists its arrays
const NO_WINNER = -1;

export class Rules {
  // Starts the module that `marl_cair.browser` has compiled.
  static async load(code) {
    const module = await WebAssembly.compile(code);
    const note = WebAssembly.Module.customSections(module, NOTE)[0];
    return new Rules(module, JSON.parse(new TextDecoder().decode(note)));
  }

  constructor(module, about) {
    const memory = new WebAssembly.Memory({ initial: about.pages });
    const stack = new WebAssembly.Global({ value: "i32", mutable: true }, about.stack);
    const table = new WebAssembly.Table({ initial: 1024, element: "anyfunc" });
    const env = {
      __linear_memory: memory, __stack_pointer: stack, __indirect_function_table: table,
      log2: Math.log2, exp2: (number) => 2 ** number, // of observations and bots, never of rules
    };
    this.functions = new WebAssembly.Instance(module, { env }).exports;
    this.arrays = {};
    this.shapes = {};
    for (const [name, { address, dtype, shape }] of Object.entries(about.arrays)) {
      const length = shape.reduce((product, side) => product * side, 1);
      this.arrays[name] = new NUMBERS[dtype](memory.buffer, address, length);
      this.shapes[name] = shape;
    }
    const world = Object.keys(this.arrays).filter((name) => name.startsWith("world."));
    this.state = [...world, "rewards", "terminated", "truncated", "winner", "eliminated"];
    [, this.numPlayers, this.numActions] = this.shapes.mask;
  }

  run(name, ...numbers) {
    const status = this.functions[name](...numbers);
    if (status !== 0) throw new Error(`the rule ${name} returned the error ${status}`);
  }

  // Begins a game; seed: a whole number below 2 ** 64.
  reset(seed) {
    const { seeds, rewards, terminated, truncated, eliminated, winner } = this.arrays;
    seeds[0] = BigInt(seed);
    for (const array of [rewards, terminated, truncated, eliminated]) array.fill(0);
    winner[0] = NO_WINNER;
    this.run("reset");
  }

  // One action of each seat.
  step(actions) {
    this.arrays.actions.set(actions);
    this.run("step");
  }

  get isOver() {
    return this.arrays.terminated[0] !== 0 || this.arrays.truncated[0] !== 0;
  }

  get winner() {
    return this.arrays.winner[0];
  }

  // A seat's legal actions: bytes that are 1, a view that the next call overwrites.
  legalActions(seat) {
    this.run("legal_actions");
    return this.arrays.mask.subarray(seat * this.numActions, (seat + 1) * this.numActions);
  }

  // What a seat observes: a view that the next call overwrites.
  observe(name, seat) {
    this.run(`observe_${name}`);
    const array = this.arrays[name], size = array.length / this.numPlayers;
    return array.subarray(seat * size, (seat + 1) * size);
  }

  // A seat's picture and its numbers (none in games without): views that the next call overwrites.
  observeBoard(seat) {
    return [this.observe("picture", seat), this.arrays.vector ? this.observe("vector", seat) : []];
  }

  // As `observeBoard`, after `ticks` ticks of a step with these actions; the state stays as it is.
  glimpse(actions, ticks, seat) {
    const kept = this.state.map((name) => this.arrays[name].slice());
    this.arrays.actions.set(actions);
    this.run("look", BigInt(ticks));
    const shown = this.observeBoard(seat);
    this.state.forEach((name, index) => this.arrays[name].set(kept[index]));
    return shown;
  }

  // SHA-256 of state and outcome, in hexadecimal; Python's `games.replays.hash_state` is its start.
  async hash() {
    const parts = this.state.map((name) => this.arrays[name]);
    const bytes = new Uint8Array(parts.reduce((sum, part) => sum + part.byteLength, 0));
    let place = 0;
    for (const part of parts) {
      bytes.set(new Uint8Array(part.buffer, part.byteOffset, part.byteLength), place);
      place += part.byteLength;
    }
    const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
    return Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
  }
}
