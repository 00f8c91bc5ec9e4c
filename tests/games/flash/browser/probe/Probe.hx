// A Flash file for tests: it counts frames and logs its input. Build: haxe -swf probe.swf -swf-version 11 -swf-header 480:360:60:FFFFFF -D haxe-boot -main Probe
import flash.display.Shape;
import flash.display.Sprite;
import flash.events.Event;
import flash.events.IOErrorEvent;
import flash.events.KeyboardEvent;
import flash.events.MouseEvent;
import flash.events.SecurityErrorEvent;
import flash.external.ExternalInterface;
import flash.net.URLLoader;
import flash.net.URLRequest;

class Probe {
	static var frames = 0;
	static var keys = 0; // held
	static var sum = 0.0;
	static var log:Array<String> = [];
	static var ball = new Shape();
	static var light = new Shape(); // shown while a key is held

	static function main() {
		var stage = flash.Lib.current.stage;
		ball.graphics.beginFill(0xCC2200);
		ball.graphics.drawCircle(0, 0, 25);
		light.graphics.beginFill(0x00AA00);
		light.graphics.drawRect(0, 0, 40, 40);
		light.visible = false;
		flash.Lib.current.addChild(ball);
		flash.Lib.current.addChild(light);
		stage.addEventListener(KeyboardEvent.KEY_DOWN, event -> press("down", event.keyCode, 1));
		stage.addEventListener(KeyboardEvent.KEY_UP, event -> press("up", event.keyCode, -1));
		for (type in [MouseEvent.MOUSE_MOVE, MouseEvent.MOUSE_DOWN, MouseEvent.MOUSE_UP, MouseEvent.CLICK])
			stage.addEventListener(type, event -> note('$type ${stage.mouseX} ${stage.mouseY}'));
		stage.addEventListener(Event.ENTER_FRAME, _ -> frame());
		ExternalInterface.addCallback("getState", () -> {
			frames: frames,
			sum: sum,
			timer: flash.Lib.getTimer(),
			date: Date.now().getTime(),
			log: log.join(", ")
		});
		ExternalInterface.addCallback("echo", value -> value);
		ExternalInterface.addCallback("runForever", () -> while (true) frames = frames);
		ExternalInterface.addCallback("callPage", (name, value) -> ExternalInterface.call(name, value));
		ExternalInterface.addCallback("fetch", fetch);
	}

	static function frame() {
		frames++;
		sum += Math.random();
		ball.x = 25 + (frames * 7) % 430;
		ball.y = 180 + 60 * Math.random();
	}

	static function press(word:String, code:Int, change:Int) {
		note('$word $code');
		keys += change;
		light.visible = keys > 0;
	}

	static function fetch(address:String) {
		var loader = new URLLoader();
		for (type in [Event.COMPLETE, IOErrorEvent.IO_ERROR, SecurityErrorEvent.SECURITY_ERROR])
			loader.addEventListener(type, _ -> note(type));
		loader.load(new URLRequest(address));
		return true;
	}

	static function note(text:String) {
		log.push('$text@$frames');
	}
}
