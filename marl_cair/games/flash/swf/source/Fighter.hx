// One of the two ships of Duel: moves, energy, shield. `facing` is 1 for the left ship and -1 for the right one.
import flash.display.Shape;
import flash.display.Sprite;

typedef Controls = {up:Int, down:Int, fire:Int, shield:Int};

class Fighter {
	public static inline var X = 200.0; // distance from the middle
	public static inline var HALF_HEIGHT = 30.0;
	public static inline var HALF_WIDTH = 16.0;
	static inline var LIVES = 3;
	static inline var STEP = 5.0; // pixels per tick
	static inline var SHIELDED_STEP = 2.0;
	static inline var MAX_ENERGY = 100.0;
	static inline var ENERGY_GAIN = 1.0; // per tick without shield
	static inline var SHOT_ENERGY = 30.0;
	static inline var SHOT_TICKS = 12; // shortest time between two shots
	static inline var SHIELD_ENERGY = 2.5; // per tick
	static inline var RAISE_ENERGY = 15.0; // needed to raise the shield
	static inline var HURT_TICKS = 10; // a hit ship blinks; no effect on the rules

	public var facing:Int;
	public var y = 0.0;
	public var step = 0.0; // of this tick
	public var energy = MAX_ENERGY;
	public var lives = LIVES;
	public var hits = 0; // on the opponent
	public var hasShield = false;

	var controls:Controls;
	var color:Int;
	var ticksToShot = 0;
	var hurt = 0;
	var view:Sprite;
	var hull:Sprite;
	var shield:Shape;
	var gauge:Shape;
	var pips:Shape; // one for each life
	var shownLives = -1;

	public function new(arena:Sprite, hud:Sprite, facing:Int, color:Int, controls:Controls) {
		this.facing = facing;
		this.controls = controls;
		view = Pen.sprite(arena, -facing * X);
		view.scaleX = facing;
		hull = Pen.sprite(view);
		var body = Pen.shape(hull);
		Pen.polygon(body, color, [-16, -30, -2, -30, 16, -12, 16, 12, -2, 30, -16, 30]);
		Pen.box(body, color, 10, -7, 20, 14, 4);
		Pen.disc(body, Pen.NIGHT, -2, 0, 8);
		Pen.box(Pen.shape(view), 0x33405E, -34, -30, 12, 60);
		gauge = Pen.shape(view, -34, 30);
		Pen.box(gauge, Pen.WHITE, 0, -60, 12, 60);
		shield = Pen.shape(view, 36);
		Pen.box(shield, Pen.WHITE, -6, -38, 12, 76, 12);
		this.color = color;
		pips = Pen.shape(hud, -facing * 222, -180);
		draw();
	}

	// Moves, shields, and returns whether a bolt leaves the gun
	public function act(keys:Keys, wall:Float):Bool {
		hasShield = keys.isDown(controls.shield) && energy >= (hasShield ? SHIELD_ENERGY : RAISE_ENERGY);
		energy = hasShield ? energy - SHIELD_ENERGY : Math.min(MAX_ENERGY, energy + ENERGY_GAIN);
		var direction = (keys.isDown(controls.down) ? 1 : 0) - (keys.isDown(controls.up) ? 1 : 0);
		step = direction * (hasShield ? SHIELDED_STEP : STEP);
		y = Math.max(HALF_HEIGHT - wall, Math.min(wall - HALF_HEIGHT, y + step));
		ticksToShot -= 1;
		if (hasShield || energy < SHOT_ENERGY || ticksToShot > 0 || !keys.isDown(controls.fire))
			return false;
		energy -= SHOT_ENERGY;
		ticksToShot = SHOT_TICKS;
		return true;
	}

	public function lose():Void {
		lives -= 1;
		hurt = HURT_TICKS;
	}

	public function draw():Void {
		view.y = y;
		gauge.scaleY = energy / MAX_ENERGY;
		shield.visible = hasShield;
		if (hurt > 0)
			hurt -= 1;
		hull.alpha = hurt % 4 > 1 ? 0.2 : 1;
		if (shownLives != lives) {
			shownLives = lives;
			pips.graphics.clear();
			for (i in 0...lives)
				Pen.disc(pips, color, facing * 30 * i, 0, 11);
		}
	}

	public function describe():Dynamic {
		return {
			y: y,
			energy: energy,
			lives: lives,
			shield: hasShield,
			ticks_to_shot: ticksToShot > 0 ? ticksToShot : 0
		};
	}
}
