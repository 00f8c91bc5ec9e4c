// Multitask: up to four tasks at once with four keys. Every tick gives a point; the game is over when one task fails.
import flash.display.Shape;
import flash.display.Sprite;
import flash.text.TextField;

class Multitask implements Game {
	static var NAMES = ["balance", "dodge", "jump", "hover"];
	static var COLORS = [0x1D4E80, 0x552B6E, 0x1E6B45, 0x8A3B2E];
	static var OPEN_TICKS = [0, 300, 900, 1800]; // when each task begins
	static inline var HARDER_TICKS = 6000.0; // a task is twice as hard this many ticks after it began
	static inline var BAR = 24; // height of the bar with score and stage
	// Keys of each task as two caps, each with the direction of its arrow
	static var CAPS = [[[-1, 0], [1, 0]], [[0, -1], [0, 1]], [[-1, 0], [1, 0]], [[0, -1], [0, 1]]];
	static var IS_CHORD = [false, false, true, true];

	public var title = "MULTITASK";
	public var help = "Arrow keys or W A S D.  Keep every task going.\nClick PLAY or press Enter";
	public var view = new Sprite();

	var random:Random;
	var tasks:Array<Task>;
	var ground:Shape; // panels behind the tasks
	var layer:Sprite; // the tasks
	var frame:Shape; // around the panels: it hides what leaves them
	var progress:Shape;
	var time = 0;
	var failed = -1;
	var score:TextField;

	static function main():Void {
		new Arcade(new Multitask());
	}

	function new() {}

	public function start(random:Random):Void {
		this.random = random;
		time = 0;
		failed = -1;
		tasks = [];
		view.removeChildren();
		ground = Pen.shape(view);
		layer = Pen.sprite(view);
		frame = Pen.shape(view);
		progress = Pen.shape(view);
		Pen.box(progress, Pen.WHITE, 0, 0, 160, 12);
		score = Pen.text(view, "0", 16, Pen.WHITE, 64, 0);
		open();
	}

	public function tick(keys:Keys):Bool {
		var steering = new Steering(keys);
		for (i in 0...tasks.length)
			if (!tasks[i].tick(steering, 1 + (time - OPEN_TICKS[i]) / HARDER_TICKS) && failed < 0)
				failed = i;
		if (failed >= 0) {
			drawFailed();
			return false;
		}
		time += 1;
		score.text = "" + time;
		if (tasks.length < 4) {
			if (time == OPEN_TICKS[tasks.length])
				open();
			else
				progress.scaleX = (time - OPEN_TICKS[tasks.length - 1]) / (OPEN_TICKS[tasks.length] - OPEN_TICKS[tasks.length - 1]);
		}
		return true;
	}

	// Begins the next task in its panel
	function open():Void {
		var i = tasks.length;
		var task:Task = switch i {
			case 0: new Balance(random);
			case 1: new Dodge(random);
			case 2: new Jump(random);
			default: new Hover(random);
		};
		task.view.x = centerX(i);
		task.view.y = centerY(i);
		layer.addChild(task.view);
		tasks.push(task);
		drawGround();
		drawFrame();
		progress.visible = i < 3;
		progress.x = centerX(i + 1) - 80;
		progress.y = centerY(i + 1) + 44;
		progress.scaleX = 0;
	}

	static function centerX(i:Int):Float {
		return 120 + 240 * (i % 2);
	}

	static function centerY(i:Int):Float {
		return BAR + 84 + 168 * (i >> 1);
	}

	// One shape, because every shape costs the player time in every frame
	function drawGround():Void {
		ground.graphics.clear();
		for (i in 0...4)
			if (i < tasks.length)
				Pen.box(ground, COLORS[i], centerX(i) - 118, centerY(i) - 82, 236, 164);
			else
				drawLocked(i);
	}

	// A dark panel with the keys of the task to come and an empty progress bar
	function drawLocked(i:Int):Void {
		var x = centerX(i);
		var y = centerY(i);
		Pen.box(ground, 0x1C2436, x - 118, y - 82, 236, 164);
		for (side in 0...2) {
			var capX = x + (side * 2 - 1) * 32;
			Pen.box(ground, 0x33405E, capX - 24, y - 38, 48, 48, 14);
			Pen.arrow(ground, 0x8D9BBD, capX, y - 14, CAPS[i][side]);
		}
		if (IS_CHORD[i])
			Pen.box(ground, 0x8D9BBD, x - 12, y - 32, 24, 8);
		Pen.box(ground, 0x33405E, x - 80, y + 44, 160, 12);
	}

	// The bar with one lamp for each stage, and the edges of the panels
	function drawFrame():Void {
		var graphics = frame.graphics;
		graphics.clear();
		graphics.beginFill(Pen.NIGHT);
		graphics.drawRect(-20, -20, 520, 400);
		for (i in 0...4)
			graphics.drawRoundRect(centerX(i) - 117, centerY(i) - 81, 234, 162, 16, 16);
		graphics.endFill();
		for (i in 0...4)
			Pen.box(frame, i < tasks.length ? Pen.WHITE : 0x33405E, 384 + 20 * i, 6, 14, 14, 6);
	}

	function drawFailed():Void {
		frame.graphics.lineStyle(10, Pen.RED);
		frame.graphics.drawRoundRect(centerX(failed) - 112, centerY(failed) - 76, 224, 152, 14, 14);
	}

	public function describe(state:Dynamic):Void {
		state.score = time;
		state.scores = [time];
		state.winner = -1;
		state.tick = time;
		state.stage = tasks.length;
		state.failed = failed < 0 ? null : NAMES[failed];
		for (i in 0...tasks.length)
			Reflect.setField(state, NAMES[i], tasks[i].describe());
	}

	public function result():String {
		return "GAME OVER\n" + time;
	}
}
