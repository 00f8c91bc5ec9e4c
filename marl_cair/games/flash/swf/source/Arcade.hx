// Runs a game: menu with mouse cursor and PLAY button, stage, game over; keys, mouse and ExternalInterface.
import flash.display.Shape;
import flash.display.Sprite;
import flash.display.Stage;
import flash.display.StageScaleMode;
import flash.events.Event;
import flash.events.KeyboardEvent;
import flash.events.MouseEvent;
import flash.external.ExternalInterface;
import flash.text.TextField;
import flash.ui.Mouse;

class Arcade {
	static inline var MENU = "menu";
	static inline var STAGE = "stage";
	static inline var OVER = "over";

	var game:Game;
	var scene = MENU;
	var random = new Random();
	var keys = new Keys();
	var menu = new Sprite();
	var button = new Sprite();
	var over = new Sprite();
	var cursor = new Shape();
	var result:TextField;

	public function new(game:Game) {
		this.game = game;
		var stage = flash.Lib.current.stage;
		stage.scaleMode = StageScaleMode.EXACT_FIT;
		stage.stageFocusRect = false;
		drawMenu();
		drawOver();
		drawCursor();
		game.start(random);
		show(MENU);
		listen(stage);
		if (ExternalInterface.available)
			ExternalInterface.addCallback("getState", describe);
	}

	function listen(stage:Stage):Void {
		stage.addEventListener(KeyboardEvent.KEY_DOWN, event -> {
			if (keys.press(event.keyCode) && event.keyCode == Keys.ENTER)
				proceed();
		});
		stage.addEventListener(KeyboardEvent.KEY_UP, event -> keys.release(event.keyCode));
		stage.addEventListener(MouseEvent.MOUSE_MOVE, event -> {
			cursor.x = event.stageX;
			cursor.y = event.stageY;
			cursor.visible = scene != STAGE;
		});
		stage.addEventListener(MouseEvent.CLICK, event -> {
			if (scene == OVER || event.target == button)
				proceed();
		});
		button.addEventListener(MouseEvent.ROLL_OVER, _ -> button.scaleX = button.scaleY = 1.08);
		button.addEventListener(MouseEvent.ROLL_OUT, _ -> button.scaleX = button.scaleY = 1);
		stage.addEventListener(Event.ENTER_FRAME, _ -> {
			if (scene == STAGE && !game.tick(keys)) {
				result.text = game.result();
				show(OVER);
			}
			keys.endFrame();
		});
	}

	// Enter or a click: menu -> stage, over -> menu
	function proceed():Void {
		if (scene == STAGE)
			return;
		game.start(random);
		show(scene == MENU ? STAGE : MENU);
	}

	function show(scene:String):Void {
		this.scene = scene;
		// What is not shown is no child: the player visits all children in every frame, seen or not
		var root = flash.Lib.current;
		root.removeChildren();
		for (layer in [game.view, scene == MENU ? menu : over, cursor])
			if (layer == game.view || scene != STAGE)
				root.addChild(layer);
		cursor.visible = scene != STAGE && (cursor.x != 0 || cursor.y != 0);
		root.stage.focus = root.stage; // keys go nowhere while a button that was removed has it
		if (ExternalInterface.available)
			ExternalInterface.call("flashEvent", "scene", scene);
	}

	function describe():Dynamic {
		var state:Dynamic = {scene: scene, done: scene == OVER};
		game.describe(state);
		return state;
	}

	function drawMenu():Void {
		Pen.box(Pen.shape(menu), Pen.NIGHT, 0, 0, 480, 360, 0, 0.86);
		Pen.text(menu, game.title, 54, Pen.WHITE, 240, 52);
		Pen.box(Pen.shape(menu), Pen.YELLOW, 200, 122, 80, 6, 6);
		button.x = 240;
		button.y = 190;
		button.buttonMode = true;
		button.mouseChildren = false;
		Pen.box(Pen.shape(button), Pen.YELLOW, -90, -32, 180, 64, 24);
		Pen.polygon(Pen.shape(button), Pen.NIGHT, [-62, -17, -62, 17, -34, 0]);
		Pen.text(button, "PLAY", 32, Pen.NIGHT, 22, -22);
		menu.addChild(button);
		Pen.text(menu, game.help, 15, Pen.WHITE, 240, 248, false);
	}

	function drawOver():Void {
		Pen.box(Pen.shape(over), Pen.NIGHT, 0, 0, 480, 360, 0, 0.55);
		Pen.box(Pen.shape(over), Pen.WHITE, 70, 112, 340, 136, 28);
		result = Pen.text(over, "", 34, Pen.NIGHT, 240, 124);
		Pen.text(over, "Press Enter or click", 15, 0x44506B, 240, 214, false);
	}

	function drawCursor():Void {
		Mouse.hide();
		Pen.polygon(cursor, Pen.NIGHT, [-3, -6, 24, 20, 13, 21, 18, 33, 9, 37, 4, 25, -3, 31]);
		Pen.polygon(cursor, Pen.WHITE, [0, 0, 18, 17, 9, 17.5, 14, 30, 10.5, 32, 5, 20, 0, 25]);
	}
}
