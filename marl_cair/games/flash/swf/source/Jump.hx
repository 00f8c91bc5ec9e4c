// Task 3: a runner jumps over hurdles. Left and right held together make it jump (and leave the paddle of task 1 alone).
import flash.display.Shape;
import flash.display.Sprite;

typedef Hurdle = {x:Float, height:Float, shape:Shape};

class Jump implements Task {
	static inline var RUNNER_X = -62.0;
	static inline var HALF_RUNNER = 13.0;
	static inline var HALF_HURDLE = 8.0;
	static inline var GROUND = 52.0;
	static inline var START_X = 135.0;
	static inline var JUMP_SPEED = 8.0; // pixels per tick
	static inline var GRAVITY = 0.5; // pixels per tick^2
	static inline var HURDLE_SPEED = 3.0;

	public var view = new Sprite();

	var random:Random;
	var height = 0.0; // of the runner's feet above the ground
	var velocity = 0.0; // upwards
	var ticksToHurdle = 1.0;
	var hurdles:Array<Hurdle> = [];
	var runner:Shape;
	var legs:Shape;
	var stride = 0.0;
	var speed = HURDLE_SPEED;

	public function new(random:Random) {
		this.random = random;
		Pen.box(Pen.shape(view), 0x7CC796, -117, GROUND, 234, 29);
		runner = Pen.shape(view, RUNNER_X, GROUND);
		Pen.box(runner, Pen.YELLOW, -HALF_RUNNER, -30, 2 * HALF_RUNNER, 25, 10);
		Pen.disc(runner, Pen.NIGHT, 6, -20, 3);
		legs = Pen.shape(view, RUNNER_X, GROUND);
		Pen.box(legs, Pen.YELLOW, -9, -6, 6, 6);
		Pen.box(legs, Pen.YELLOW, 3, -6, 6, 6);
	}

	public function tick(keys:Steering, hardness:Float):Bool {
		if (keys.leftAndRight && height == 0)
			velocity = JUMP_SPEED;
		height += velocity;
		velocity -= GRAVITY;
		if (height <= 0)
			height = velocity = 0;
		ticksToHurdle -= 1;
		if (ticksToHurdle <= 0) {
			ticksToHurdle += random.between(55, 100) / hardness;
			launch();
		}
		speed = HURDLE_SPEED * hardness;
		var isHit = false;
		for (hurdle in hurdles.copy()) {
			hurdle.x -= speed;
			hurdle.shape.x = hurdle.x;
			if (Math.abs(hurdle.x - RUNNER_X) < HALF_RUNNER + HALF_HURDLE && height < hurdle.height)
				isHit = true;
			if (hurdle.x < -START_X) {
				hurdles.remove(hurdle);
				view.removeChild(hurdle.shape);
			}
		}
		draw(hardness);
		return !isHit;
	}

	function draw(hardness:Float):Void {
		runner.y = legs.y = GROUND - height;
		stride += 0.35 * hardness;
		legs.scaleX = height > 0 ? 1 : Math.cos(stride);
	}

	function launch():Void {
		var height = random.between(16, 28);
		var shape = Pen.shape(view, START_X, GROUND);
		Pen.box(shape, Pen.WHITE, -HALF_HURDLE, -height, 2 * HALF_HURDLE, height + 4, 6);
		hurdles.push({x: START_X, height: height, shape: shape});
	}

	public function describe():Dynamic {
		return {
			height: height,
			velocity: velocity,
			hurdles: [for (hurdle in hurdles) {distance: hurdle.x - RUNNER_X, height: hurdle.height, speed: speed}]
		};
	}
}
