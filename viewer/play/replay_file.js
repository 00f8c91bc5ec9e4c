// Writes a game as a replay file, as marl_cair/games/replays/layout.py describes it: Python plays
// it again and compares the hash of the last state.

const HASH_BYTES = 8;
const WINDOW_OF_4096 = [0x48, 0x0d]; // the head of a deflate stream
const LONGEST_BLOCK = 65535;

// game: the entry of the page. played: actions of all seats, step by step. hash: SHA-256, in hexadecimal.
export function makeReplay(game, seed, players, played, hash, winner) {
  const text = JSON.stringify({
    format: "marl_cair replay", format_version: 2, game: game.name, rules_version: game.version,
    scenario: game.options, games: [{ map_seed: 0, players, extra: { played_in: "browser" } }],
  }).replace('"map_seed":0', `"map_seed":${BigInt(seed)}`); // numbers of JavaScript end at 2 ** 53
  const count = new Uint8Array(new Uint32Array([played.length]).buffer);
  const gameAndCount = [0, 0, 0, 0, ...count];
  const digest = Array.from({ length: HASH_BYTES }, (_, at) => parseInt(hash.slice(2 * at, 2 * at + 2), 16));
  return new Blob([
    `${text}\n`,
    record("h", Uint8Array.from([...gameAndCount, ...digest])),
    record("e", Uint8Array.from([...gameAndCount, winner])),
    ...(played.length > 0 ? [record("s", Uint8Array.from([...count, ...store(packActions(played, game.actions.groups.length))]))] : []),
  ]);
}

function packActions(played, numActions) {
  const Numbers = numActions <= 256 ? Uint8Array : numActions <= 65536 ? Uint16Array : Uint32Array;
  return new Uint8Array(Numbers.from(played.flat()).buffer);
}

// A deflate stream without compression: blocks of length, its complement, and the bytes.
function store(bytes) {
  const parts = [WINDOW_OF_4096];
  for (let at = 0; at < bytes.length; at += LONGEST_BLOCK) {
    const block = bytes.subarray(at, at + LONGEST_BLOCK), size = block.length;
    parts.push([0, size & 255, size >> 8, ~size & 255, (~size >> 8) & 255], block);
  }
  const whole = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let place = 0;
  for (const part of parts) { whole.set(part, place); place += part.length; }
  return whole;
}

function record(kind, payload) {
  const head = new DataView(new ArrayBuffer(9));
  head.setUint8(0, kind.charCodeAt(0));
  head.setUint32(1, payload.length, true);
  const start = crc32(new Uint8Array(head.buffer, 0, 5), 0);
  head.setUint32(5, crc32(payload, start), true);
  return new Blob([head, payload]);
}

// CRC-32 of `bytes` after others whose CRC-32 is `before`.
function crc32(bytes, before) {
  let rest = ~before;
  for (const byte of bytes) {
    rest ^= byte;
    for (let bit = 0; bit < 8; bit++) rest = (rest >>> 1) ^ (rest & 1 ? 0xedb88320 : 0);
  }
  return ~rest >>> 0;
}
