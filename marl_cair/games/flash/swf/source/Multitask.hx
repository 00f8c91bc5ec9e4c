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
	// Keys of each task as two caps; an angle of degrees clockwise from "up"
	static var CAPS = [[270, 90], [0, 180], [270, 90], [0, 180]];
	static var IS_CHORD = [false, false, true, true];

	public var title = "MULTITASK";
	public var help = "Arrow keys or W A S D.  Keep every task going.\nClick PLAY or press Enter";
	public var view = new Sprite();

	var random:Random;
	var tasks:Array<Task>;
	var panels:Array<Sprite>;
	var progress:Shape;
	var time = 0;
	var failed = -1;
	var score:TextField;
	var stage:TextField;

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
		Pen.box(Pen.shape(view), Pen.NIGHT, 0, 0, 480, 360);
		panels = [for (i in 0...4) drawLocked(i)];
		score = Pen.text(view, "0", 16, Pen.WHITE, 64, 0);
		stage = Pen.text(view, "", 16, Pen.WHITE, 416, 0);
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
		tasks.push(task);
		panels[i].removeChildren();
		Pen.box(Pen.shape(panels[i]), COLORS[i], -117, -81, 234, 162, 16);
		panels[i].addChild(task.view);
		var edge = Pen.shape(panels[i]);
		Pen.box(edge, 0, -117, -81, 234, 162);
		task.view.mask = edge;
		stage.text = "STAGE " + (i + 1);
		if (i < 3) {
			progress = Pen.shape(panels[i + 1], -80, 44);
			Pen.box(progress, Pen.WHITE, 0, 0, 160, 12);
			progress.scaleX = 0;
		}
	}

	// A dark panel with the keys of the task to come and an empty progress bar
	function drawLocked(i:Int):Sprite {
		var panel = Pen.sprite(view, 120 + 240 * (i % 2), BAR + 84 + 168 * (i >> 1));
		Pen.box(Pen.shape(panel), 0x1C2436, -117, -81, 234, 162, 16);
		for (side in 0...2) {
			var cap = Pen.shape(panel, (side * 2 - 1) * 32, -14);
			Pen.box(cap, 0x33405E, -24, -24, 48, 48, 14);
			var arrow = Pen.shape(panel, cap.x, cap.y);
			Pen.polygon(arrow, 0x8D9BBD, [0, -12, 12, 9, -12, 9]);
			arrow.rotation = CAPS[i][side];
		}
		if (IS_CHORD[i])
			Pen.box(Pen.shape(panel), 0x8D9BBD, -12, -18, 24, 8);
		Pen.box(Pen.shape(panel), 0x33405E, -80, 44, 160, 12);
		return panel;
	}

	function drawFailed():Void {
		var frame = Pen.shape(panels[failed]);
		frame.graphics.lineStyle(10, Pen.RED);
		frame.graphics.drawRoundRect(-112, -76, 224, 152, 14, 14);
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
