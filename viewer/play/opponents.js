// The other seats: a bot that is compiled with the rules, or a network that onnxruntime-web runs.

// readFile: gives the bytes of a file in the page, by its name.
export async function loadOpponent(rules, about, readFile) {
  return about.kind === "bot" ? new Bot(rules, about) : Network.load(rules, about, readFile);
}

class Bot {
  constructor(rules, about) {
    this.rules = rules;
    this.representation = about.representation;
  }

  restart(seed) {
    this.rules.arrays.random[0] = BigInt(seed);
  }

  async decide(seats) {
    this.rules.legalActions(0);
    this.rules.observe(this.representation, 0);
    this.rules.run("decide");
    return seats.map((seat) => Number(this.rules.arrays.decisions[seat]));
  }
}

class Network {
  static async load(rules, about, readFile) {
    const script = new Blob([await readFile("ort.wasm.bundle.min.mjs")], { type: "text/javascript" });
    const runtime = await import(URL.createObjectURL(script));
    runtime.env.wasm.numThreads = 1; // more need headers that static hosts do not send
    runtime.env.wasm.wasmBinary = await readFile("ort-wasm-simd-threaded.wasm");
    const session = await runtime.InferenceSession.create(await readFile("agent.onnx"));
    return new Network(rules, about, runtime, session);
  }

  constructor(rules, about, runtime, session) {
    Object.assign(this, { rules, about, runtime, session, states: new Map() });
  }

  restart() {
    this.states.clear();
  }

  async decide(seats) {
    const actions = [];
    for (const seat of seats) actions.push(await this.decideOne(seat));
    return actions;
  }

  async decideOne(seat) {
    const { Tensor } = this.runtime;
    const { representation, dtype, stateSize, plays } = this.about;
    const seen = this.rules.observe(representation, seat).slice();
    const mask = this.rules.legalActions(seat).slice();
    const feeds = {
      observation: new Tensor(dtype, seen, [1, ...this.rules.shapes[representation].slice(2)]),
      action_mask: new Tensor("bool", mask, [1, mask.length]),
    };
    if (stateSize > 0) {
      const state = this.states.get(seat) ?? new Float32Array(stateSize);
      feeds.state = new Tensor("float32", state, [1, stateSize]);
    }
    const found = await this.session.run(feeds);
    if (stateSize > 0) this.states.set(seat, Float32Array.from(found.next_state.data));
    return plays === "greedy" ? Number(found.action.data[0]) : sample(found.values.data);
  }
}

// An action by the softmax over the values; those of illegal actions are -Infinity.
function sample(values) {
  const highest = Math.max(...values);
  const weights = Array.from(values, (value) => Math.exp(value - highest));
  let left = Math.random() * weights.reduce((sum, weight) => sum + weight, 0);
  for (let action = 0; action < weights.length; action++) {
    left -= weights[action];
    if (left < 0) return action;
  }
  return weights.findLastIndex((weight) => weight > 0);
}
