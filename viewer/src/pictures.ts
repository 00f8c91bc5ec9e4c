// Unpacks the pictures of a view (as marl_cair/viewer/tiles.py packs them) and draws any of them.

import { inflate, readBytes, type PackedPictures } from "./data";

const TILE = 8;
const NEW = 0;
const OTHER = 255;
const LONG_GAP = 255;
const KEY_EVERY = 64; // pictures of which the whole grid is kept, so that a jump is quick

export class Pictures {
  readonly count: number;
  private readonly keys: Int32Array[] = [];

  private constructor(
    readonly width: number,
    readonly height: number,
    readonly left: number, // of the picture within its tiles
    readonly top: number,
    readonly columns: number,
    readonly rows: number,
    readonly atlas: Uint32Array,
    readonly atlasWidth: number,
    private readonly starts: number[], // of each picture in the next two
    private readonly places: number[],
    private readonly tiles: number[],
  ) {
    this.count = starts.length - 1;
    const grid = new Int32Array(columns * rows);
    for (let picture = 0; picture < this.count; picture++) {
      this.change(grid, picture);
      if (picture % KEY_EVERY === 0) this.keys.push(grid.slice());
    }
  }

  static async unpack(packed: PackedPictures): Promise<Pictures> {
    const [atlas, atlasWidth] = await readAtlas(packed.atlas);
    const { width, height, left, top } = packed;
    const columns = Math.ceil((left + width) / TILE);
    const rows = Math.ceil((top + height) / TILE);
    const changes = readChanges(await inflate(packed.changes), columns * rows);
    return new Pictures(width, height, left, top, columns, rows, atlas, atlasWidth, ...changes);
  }

  /** The numbers of the tiles of a picture, row by row. */
  gridOf(picture: number): Int32Array {
    const key = Math.floor(picture / KEY_EVERY);
    const grid = this.keys[key].slice();
    for (let next = key * KEY_EVERY + 1; next <= picture; next++) this.change(grid, next);
    return grid;
  }

  private change(grid: Int32Array, picture: number): void {
    for (let at = this.starts[picture]; at < this.starts[picture + 1]; at++) {
      grid[this.places[at]] = this.tiles[at];
    }
  }
}

async function readAtlas(text: string): Promise<[Uint32Array, number]> {
  const blob = new Blob([readBytes(text)], { type: "image/webp" });
  const image = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [image.width, image.height];
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(image, 0, 0);
  const pixels = context.getImageData(0, 0, image.width, image.height).data;
  return [new Uint32Array(pixels.buffer), image.width];
}

function readChanges(bytes: Uint8Array, numPlaces: number): [number[], number[], number[]] {
  const view = new DataView(bytes.buffer, bytes.byteOffset);
  const parts: Uint8Array[] = [];
  for (let at = 0; at < bytes.length; ) {
    const size = view.getUint32(at, true);
    parts.push(bytes.subarray(at + 4, at + 4 + size));
    at += 4 + size;
  }
  const [gaps, codes, others] = parts;
  const starts: number[] = [0];
  const places: number[] = [];
  const tiles: number[] = [];
  const shown: number[][] = Array.from({ length: numPlaces }, () => []);
  const numOthers = others.length / 3;
  let [other, next, place] = [0, 0, -1];
  for (let at = 0; at < gaps.length; at++) {
    let gap = gaps[at];
    if (gap === 0) {
      starts.push(places.length);
      place = -1;
      continue;
    }
    if (gap === LONG_GAP) {
      gap = gaps[at + 1] + gaps[at + 2] * 256;
      at += 2;
    }
    place += gap;
    const code = codes[places.length];
    const before = shown[place];
    let tile: number;
    if (code === NEW) tile = next++;
    else if (code === OTHER) {
      tile = others[other] + others[other + numOthers] * 256 + others[other + 2 * numOthers] * 65536;
      other++;
    } else tile = before.splice(code, 1)[0];
    before.unshift(tile);
    if (before.length > OTHER) before.length = OTHER;
    places.push(place);
    tiles.push(tile);
  }
  return [starts, places, tiles];
}

/** A canvas that shows one picture at a time, and draws only the tiles that differ. */
export class Screen {
  private pictures: Pictures | undefined;
  private shown: Int32Array = new Int32Array();
  private image = new ImageData(1, 1);
  private pixels = new Uint32Array();

  constructor(private readonly canvas: HTMLCanvasElement) {}

  draw(pictures: Pictures, picture: number): void {
    const { columns, rows, atlas, atlasWidth } = pictures;
    if (pictures !== this.pictures) {
      this.pictures = pictures;
      [this.canvas.width, this.canvas.height] = [pictures.width, pictures.height];
      this.image = new ImageData(columns * TILE, rows * TILE);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.shown = new Int32Array(columns * rows).fill(-1);
    }
    const grid = pictures.gridOf(picture);
    const perRow = atlasWidth / TILE;
    for (let place = 0; place < grid.length; place++) {
      const tile = grid[place];
      if (tile === this.shown[place]) continue;
      let from = Math.floor(tile / perRow) * TILE * atlasWidth + (tile % perRow) * TILE;
      let to = Math.floor(place / columns) * TILE * columns * TILE + (place % columns) * TILE;
      for (let row = 0; row < TILE; row++) {
        this.pixels.set(atlas.subarray(from, from + TILE), to);
        from += atlasWidth;
        to += columns * TILE;
      }
    }
    this.shown = grid;
    const context = this.canvas.getContext("2d", { willReadFrequently: true })!;
    context.putImageData(this.image, -pictures.left, -pictures.top);
  }
}
