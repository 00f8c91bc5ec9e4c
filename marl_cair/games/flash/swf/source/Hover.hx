// Task 4: a balloon sinks, and gusts move it. Up and down held together heat it (and leave the avatar of task 2 alone).
import flash.display.Shape;
import flash.display.Sprite;

class Hover implements Task {
	static inline var LIMIT = 44.0; // the balloon's centre stays between -LIMIT and LIMIT
	static inline var SINK = 0.03; // pixels per tick^2
	static inline var HEAT = 0.13;
	static inline var DRAG = 0.03; // of the speed per tick
	static inline var GUST = 0.012;
	static inline var GUST_TICKS = 45;

	public var view = new Sprite();

	var random:Random;
	var y = 0.0;
	var velocity = 0.0; // downwards
	var gust = 0.0;
	var ticksToGust = 0;
	var balloon:Sprite;
	var flame:Shape;

	public function new(random:Random) {
		this.random = random;
		var spikes = Pen.shape(view);
		for (i in -5...6) {
			Pen.polygon(spikes, Pen.WHITE, [22 * i - 11, -81, 22 * i + 11, -81, 22 * i, -66]);
			Pen.polygon(spikes, Pen.WHITE, [22 * i - 11, 81, 22 * i + 11, 81, 22 * i, 66]);
		}
		balloon = Pen.sprite(view);
		var body = Pen.shape(balloon);
		Pen.disc(body, Pen.YELLOW, 0, -4, 18);
		Pen.polygon(body, Pen.YELLOW, [-15, 5, 15, 5, 6, 17, -6, 17]);
		Pen.box(body, 0xC98F12, -6, -22, 12, 36, 12);
		Pen.box(body, Pen.WHITE, -7, 17, 14, 8, 4);
		flame = Pen.shape(balloon);
		Pen.polygon(flame, Pen.RED, [-6, 17, 6, 17, 0, 3]);
		flame.visible = false;
	}

	public function tick(keys:Steering, hardness:Float):Bool {
		if (ticksToGust == 0) {
			ticksToGust = GUST_TICKS;
			gust = random.between(-GUST, GUST);
		}
		ticksToGust -= 1;
		velocity += (SINK + gust) * hardness - (keys.upAndDown ? HEAT : 0) - DRAG * velocity;
		y += velocity;
		balloon.y = y;
		flame.visible = keys.upAndDown;
		return Math.abs(y) <= LIMIT;
	}

	public function describe():Dynamic {
		return {y: y, velocity: velocity, gust: gust, limit: LIMIT};
	}
}
