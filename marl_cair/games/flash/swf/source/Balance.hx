// Task 1: a ball rolls on a paddle that left and right tilt. The ball's weight tilts the paddle too. It must not roll off.
import flash.display.Shape;
import flash.display.Sprite;

class Balance implements Task {
	static inline var HALF_LENGTH = 92.0;
	static inline var RADIUS = 17.0;
	static inline var THICKNESS = 14.0;
	static inline var GRAVITY = 0.5; // pixels per tick^2
	static inline var STEER = 0.006; // radians per tick^2
	static inline var WEIGHT = 0.0012; // radians per tick^2 with the ball at the end of the paddle
	static inline var FRICTION = 0.08; // of the turning speed per tick
	static inline var MAX_ANGLE = 0.6;

	public var view = new Sprite();

	var position = 0.0; // of the ball along the paddle, 0 in the middle
	var velocity = 0.0;
	var angle:Float; // positive: the right end is low
	var turn = 0.0; // radians per tick
	var paddle:Sprite;
	var ball:Shape;

	public function new(random:Random) {
		angle = random.sign() * random.between(0.02, 0.06);
		var stand = Pen.shape(view);
		Pen.polygon(stand, 0x7FB2E8, [0, 30, 34, 81, -34, 81]);
		paddle = Pen.sprite(view, 0, 26);
		var board = Pen.shape(paddle);
		Pen.box(board, Pen.WHITE, -HALF_LENGTH, -THICKNESS / 2, 2 * HALF_LENGTH, THICKNESS, THICKNESS);
		Pen.disc(board, 0x1D4E80, 0, 0, 4);
		ball = Pen.shape(paddle, 0, -THICKNESS / 2 - RADIUS);
		Pen.disc(ball, Pen.YELLOW, 0, 0, RADIUS);
		Pen.disc(ball, 0xC98F12, 8, 0, 4);
		draw();
	}

	public function tick(keys:Steering, hardness:Float):Bool {
		turn += keys.x * STEER + position / HALF_LENGTH * WEIGHT - turn * FRICTION;
		angle += turn;
		if (Math.abs(angle) > MAX_ANGLE) {
			angle = angle > 0 ? MAX_ANGLE : -MAX_ANGLE;
			turn = 0;
		}
		velocity += GRAVITY * hardness * Math.sin(angle);
		position += velocity;
		draw();
		return Math.abs(position) <= HALF_LENGTH;
	}

	function draw():Void {
		paddle.rotation = angle * 180 / Math.PI;
		ball.x = position;
		ball.rotation = position / RADIUS * 180 / Math.PI;
	}

	public function describe():Dynamic {
		return {position: position, velocity: velocity, angle: angle, turn: turn, half_length: HALF_LENGTH};
	}
}
