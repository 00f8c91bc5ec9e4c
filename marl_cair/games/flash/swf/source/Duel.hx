// Duel: two ships shoot at each other. Shields throw bolts back, a block in the middle stops them, walls close in.
import flash.display.Shape;
import flash.display.Sprite;

typedef Bolt = {x:Float, y:Float, vx:Float, vy:Float, owner:Int, shape:Shape};

class Duel implements Game {
	// Both colours are equally bright, so that a mirrored grey picture looks the same
	static var COLORS = [0x4FC3F7, 0xFF8B4A];
	static inline var BOLT_SPEED = 14.0; // pixels per tick
	static inline var DRIFT = 0.4; // share of the ship's own step that its bolt keeps
	static inline var HALF_BOLT = 20.0; // length
	static inline var HALF_BOLT_HEIGHT = 7.0;
	static inline var EDGE = 262.0; // a bolt that is further from the middle is gone
	static inline var WIDE = 160.0; // half the height of the arena before the walls close in
	static inline var NARROW = 60.0; // and in the end
	static inline var CLOSING_TICKS = 300; // when the walls begin to close in
	static inline var CLOSING_SPEED = 0.15;
	static inline var HALF_BLOCK = 14.0; // width of the block
	static inline var BLOCK_SPEED = 1.5;
	static inline var LIMIT_TICKS = 1800;

	public var title = "DUEL";
	public var help = "Blue: W S move, D fires, A shields\nOrange: Up Down move, Left fires, Right shields\nClick PLAY or press Enter";
	public var view = new Sprite();

	var arena:Sprite;
	var fighters:Array<Fighter>;
	var bolts:Array<Bolt>;
	var boltLayer:Sprite;
	var wall = WIDE;
	var walls:Array<Shape>;
	var block:Shape;
	var clock:Shape;
	var blockY = 0.0;
	var blockStep = BLOCK_SPEED;
	var time = 0;

	static function main():Void {
		new Arcade(new Duel());
	}

	function new() {}

	public function start(random:Random):Void {
		time = 0;
		wall = WIDE;
		bolts = [];
		blockY = random.between(-60, 60);
		blockStep = random.sign() * BLOCK_SPEED;
		view.removeChildren();
		arena = Pen.sprite(view, 240, 195);
		var ground = Pen.shape(arena); // one shape, because every shape costs the player time in every frame
		Pen.box(ground, Pen.NIGHT, -240, -195, 480, 360);
		for (i in -8...9)
			Pen.box(ground, 0x1C2436, -4, 20 * i - 5, 8, 10);
		boltLayer = Pen.sprite(arena);
		block = Pen.shape(arena);
		Pen.box(block, 0x9AA8C7, -HALF_BLOCK, -HALF_BLOCK, 2 * HALF_BLOCK, 2 * HALF_BLOCK);
		walls = [for (side in 0...2) Pen.shape(arena)];
		for (shape in walls)
			Pen.box(shape, 0x55627F, -240, 0, 480, 200);
		walls[0].scaleY = -1;
		var hud = Pen.sprite(arena);
		Pen.box(Pen.shape(hud), 0x1C2436, -240, -195, 480, 30);
		clock = Pen.shape(hud, 0, -180);
		Pen.box(clock, Pen.WHITE, -110, -5, 220, 10);
		fighters = [
			new Fighter(arena, hud, 1, COLORS[0], {up: Keys.W, down: Keys.S, fire: Keys.D, shield: Keys.A}),
			new Fighter(arena, hud, -1, COLORS[1], {up: Keys.UP, down: Keys.DOWN, fire: Keys.LEFT, shield: Keys.RIGHT})
		];
		draw();
	}

	public function tick(keys:Keys):Bool {
		time += 1;
		if (time > CLOSING_TICKS)
			wall = Math.max(NARROW, wall - CLOSING_SPEED);
		for (i in 0...2)
			if (fighters[i].act(keys, wall))
				shoot(i);
		moveBlock();
		for (bolt in bolts.copy())
			if (!fly(bolt)) {
				bolts.remove(bolt);
				boltLayer.removeChild(bolt.shape);
			}
		draw();
		return time < LIMIT_TICKS && fighters[0].lives > 0 && fighters[1].lives > 0;
	}

	function shoot(owner:Int):Void {
		var fighter = fighters[owner];
		var x = -fighter.facing * (Fighter.X - 30);
		var bolt:Bolt = {
			x: x, y: fighter.y, vx: fighter.facing * BOLT_SPEED, vy: fighter.step * DRIFT, owner: owner, shape: Pen.shape(boltLayer)
		};
		bolts.push(bolt);
		paint(bolt);
	}

	// A comet in the colour of its owner, its head in front
	function paint(bolt:Bolt):Void {
		bolt.shape.graphics.clear();
		Pen.polygon(bolt.shape, COLORS[bolt.owner], [-32, 0, 4, -9, 4, 9]);
		Pen.disc(bolt.shape, COLORS[bolt.owner], 8, 0, 11);
		Pen.disc(bolt.shape, Pen.WHITE, 8, 0, 7);
		bolt.shape.scaleX = bolt.vx > 0 ? 1 : -1;
	}

	// Moves a bolt; false when it is gone
	function fly(bolt:Bolt):Bool {
		bolt.x += bolt.vx;
		bolt.y += bolt.vy;
		var limit = wall - HALF_BOLT_HEIGHT;
		if (Math.abs(bolt.y) > limit) {
			bolt.vy = bolt.y > 0 ? -Math.abs(bolt.vy) : Math.abs(bolt.vy);
			bolt.y = bolt.y > 0 ? limit : -limit;
		}
		if (Math.abs(bolt.x) < HALF_BLOCK + HALF_BOLT && Math.abs(bolt.y - blockY) < halfBlock() + HALF_BOLT_HEIGHT)
			return false;
		var target = fighters[1 - bolt.owner];
		var dx = bolt.x + target.facing * Fighter.X;
		var dy = bolt.y - target.y;
		if (target.hasShield && Math.abs(dx) < HALF_BOLT + 42 && Math.abs(dy) < 38 + HALF_BOLT_HEIGHT) {
			bolt.vx = -bolt.vx;
			bolt.owner = 1 - bolt.owner;
			paint(bolt);
		} else if (Math.abs(dx) < HALF_BOLT + Fighter.HALF_WIDTH && Math.abs(dy) < Fighter.HALF_HEIGHT + HALF_BOLT_HEIGHT) {
			target.lose();
			fighters[bolt.owner].hits += 1;
			return false;
		}
		return Math.abs(bolt.x) < EDGE;
	}

	function halfBlock():Float {
		return wall / 5;
	}

	function moveBlock():Void {
		var limit = wall - halfBlock();
		blockY += blockStep;
		if (Math.abs(blockY) >= limit) {
			blockY = blockY > 0 ? limit : -limit;
			blockStep = blockY > 0 ? -BLOCK_SPEED : BLOCK_SPEED;
		}
	}

	function draw():Void {
		for (fighter in fighters)
			fighter.draw();
		for (bolt in bolts) {
			bolt.shape.x = bolt.x;
			bolt.shape.y = bolt.y;
		}
		block.y = blockY;
		block.scaleY = halfBlock() / HALF_BLOCK;
		walls[0].y = -wall;
		walls[1].y = wall;
		clock.scaleX = 1 - time / LIMIT_TICKS;
	}

	function winner():Int {
		var difference = fighters[0].lives - fighters[1].lives;
		return difference == 0 ? -1 : (difference > 0 ? 0 : 1);
	}

	public function describe(state:Dynamic):Void {
		var isOver:Bool = state.done;
		state.score = fighters[0].hits - fighters[1].hits;
		state.scores = [for (fighter in fighters) fighter.hits];
		state.winner = isOver ? winner() : -1;
		state.tick = time;
		state.players = [for (fighter in fighters) fighter.describe()];
		state.bolts = [
			for (bolt in bolts)
				{x: bolt.x, y: bolt.y, vx: bolt.vx, vy: bolt.vy, owner: bolt.owner}
		];
		state.block = {y: blockY, step: blockStep, half_height: halfBlock()};
		state.wall = wall;
	}

	public function result():String {
		return switch winner() {
			case 0: "BLUE WINS\n" + score();
			case 1: "ORANGE WINS\n" + score();
			default: "DRAW\n" + score();
		};
	}

	function score():String {
		return fighters[0].hits + " : " + fighters[1].hits;
	}
}
