// Keeps the present step of a game and moves it as time passes.

export const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];

export class Playback {
  step = 0;
  speed = SPEEDS.indexOf(1);
  isPlaying = false;
  private owed = 0; // part of a step
  private before = 0;

  constructor(
    readonly steps: number,
    private readonly fps: number,
    private readonly show: () => void, // after every change
  ) {}

  seek(step: number): void {
    this.step = Math.min(this.steps, Math.max(0, Math.round(step)));
    this.show();
  }

  /** Pauses, and moves by so many steps. */
  move(steps: number): void {
    this.isPlaying = false;
    this.seek(this.step + steps);
  }

  setSpeed(speed: number): void {
    this.speed = Math.min(SPEEDS.length - 1, Math.max(0, speed));
    this.show();
  }

  toggle(): void {
    this.isPlaying = !this.isPlaying;
    if (this.isPlaying && this.step === this.steps) this.step = 0;
    this.show();
    if (!this.isPlaying) return;
    [this.owed, this.before] = [0, performance.now()];
    requestAnimationFrame((now) => this.advance(now));
  }

  private advance(now: number): void {
    if (!this.isPlaying) return;
    this.owed += (Math.max(0, now - this.before) / 1000) * this.fps * SPEEDS[this.speed];
    this.before = now;
    const whole = Math.floor(this.owed);
    this.owed -= whole;
    if (this.step + whole >= this.steps) this.isPlaying = false;
    if (whole) this.seek(this.step + whole);
    if (this.isPlaying) requestAnimationFrame((next) => this.advance(next));
  }
}
