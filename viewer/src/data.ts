// Describes the JSON that marl_cair/viewer/game_data.py writes, and unpacks its bytes and numbers.

export interface PackedPictures {
  width: number;
  height: number;
  left: number; // pixels of the first tile that are not in the picture
  top: number;
  atlas: string;
  changes: string;
}

export interface View {
  seat: number | null; // null: the spectator, who sees everything
  colours: string[];
  pictures: number; // index of Game.pictures
}

export interface Series {
  name: string;
  isResource: boolean;
  values: string; // [steps + 1, players]
}

export interface Choices {
  name: string;
  count: number;
  texts: string[];
  choices: string; // [steps, players, count], places in texts
  values: string;
}

export interface GameEvent {
  step: number;
  text: string;
  seat: number | null;
}

export interface Game {
  title: string;
  rules: string;
  players: string[];
  steps: number;
  fps: number; // steps in a second at speed 1
  secondsPerStep: number; // of the game's own time
  every: number; // pictures are of each so many steps, and of the end
  numLeftOut: number;
  pictures: PackedPictures[];
  views: View[];
  series: Series[];
  events: GameEvent[];
  actions: { texts: string[]; numbers: string }; // [steps, players], places in texts
  values: Choices[];
}

export function readBytes(text: string): Uint8Array<ArrayBuffer> {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

export async function inflate(text: string): Promise<Uint8Array> {
  const stream = new Blob([readBytes(text)]).stream();
  const inflated = stream.pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(inflated).arrayBuffer());
}

/** float32 numbers, of which all first bytes come first. */
export async function readNumbers(text: string): Promise<Float32Array> {
  const planes = await inflate(text);
  const count = planes.length / 4;
  const bytes = new Uint8Array(planes.length);
  for (let index = 0; index < planes.length; index++) {
    bytes[(index % count) * 4 + Math.floor(index / count)] = planes[index];
  }
  return new Float32Array(bytes.buffer);
}
