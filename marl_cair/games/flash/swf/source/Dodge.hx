// Task 2: arrows fly in from both sides. Up and down move the avatar out of their way.
import flash.display.Shape;
import flash.display.Sprite;

typedef Arrow = {x:Float, y:Float, speed:Float, shape:Shape};

class Dodge implements Task {
	static inline var HALF_AVATAR = 12.0;
	static inline var HALF_LENGTH = 24.0; // of an arrow
	static inline var HALF_THICKNESS = 8.0; // of an arrow, for hits
	static inline var TOP = 66.0; // the avatar moves between -TOP and TOP
	static inline var START_X = 140.0;
	static inline var STEP = 4.0; // pixels per tick
	static inline var ARROW_SPEED = 2.6;
	static inline var ARROW_TICKS = 48.0; // between two arrows at hardness 1
	static inline var AIMED = 0.6; // share of arrows that fly at the avatar

	public var view = new Sprite();

	var random:Random;
	var y = 0.0;
	var ticksToArrow = 1.0;
	var arrows:Array<Arrow> = [];
	var avatar:Shape;

	public function new(random:Random) {
		this.random = random;
		Pen.box(Pen.shape(view), 0x7A4A93, -3, -TOP - HALF_AVATAR, 6, 2 * (TOP + HALF_AVATAR), 6);
		avatar = Pen.shape(view);
		Pen.box(avatar, Pen.YELLOW, -HALF_AVATAR, -HALF_AVATAR, 2 * HALF_AVATAR, 2 * HALF_AVATAR, 10);
		Pen.disc(avatar, Pen.NIGHT, -5, -2, 3);
		Pen.disc(avatar, Pen.NIGHT, 5, -2, 3);
	}

	public function tick(keys:Steering, hardness:Float):Bool {
		y = Math.max(-TOP, Math.min(TOP, y + keys.y * STEP));
		avatar.y = y;
		ticksToArrow -= 1;
		if (ticksToArrow <= 0) {
			ticksToArrow += ARROW_TICKS / hardness;
			launch(ARROW_SPEED * hardness);
		}
		var isHit = false;
		for (arrow in arrows.copy()) {
			arrow.x += arrow.speed;
			arrow.shape.x = arrow.x;
			if (Math.abs(arrow.x) < HALF_LENGTH + HALF_AVATAR && Math.abs(arrow.y - y) < HALF_THICKNESS + HALF_AVATAR)
				isHit = true;
			if (arrow.x * arrow.speed > 0 && Math.abs(arrow.x) > START_X) {
				arrows.remove(arrow);
				view.removeChild(arrow.shape);
			}
		}
		return !isHit;
	}

	function launch(speed:Float):Void {
		var side = random.sign();
		var height = random.between(0, 1) < AIMED ? y : random.between(-TOP, TOP);
		var shape = Pen.shape(view, side * START_X, height);
		Pen.box(shape, Pen.WHITE, -24, -5, 30, 10);
		Pen.polygon(shape, Pen.WHITE, [2, -13, 24, 0, 2, 13]);
		shape.scaleX = -side;
		arrows.push({x: side * START_X, y: height, speed: -side * speed, shape: shape});
	}

	public function describe():Dynamic {
		return {y: y, arrows: [for (arrow in arrows) {x: arrow.x, y: arrow.y, speed: arrow.speed}]};
	}
}
