// Flat shapes and text in the colours of both games.
import flash.display.Shape;
import flash.display.Sprite;
import flash.text.TextField;
import flash.text.TextFormat;
import flash.text.TextFormatAlign;

class Pen {
	public static inline var NIGHT = 0x0E131F;
	public static inline var WHITE = 0xF7FAFF;
	public static inline var YELLOW = 0xFFD447;
	public static inline var RED = 0xFF5A5F;

	public static function box(on:Shape, color:Int, x:Float, y:Float, width:Float, height:Float, round = 0.0, alpha = 1.0):Void {
		on.graphics.beginFill(color, alpha);
		if (round > 0)
			on.graphics.drawRoundRect(x, y, width, height, round, round);
		else
			on.graphics.drawRect(x, y, width, height);
		on.graphics.endFill();
	}

	public static function disc(on:Shape, color:Int, x:Float, y:Float, radius:Float):Void {
		on.graphics.beginFill(color);
		on.graphics.drawCircle(x, y, radius);
		on.graphics.endFill();
	}

	// Corners as x, y, x, y, ...
	public static function polygon(on:Shape, color:Int, corners:Array<Float>):Void {
		on.graphics.beginFill(color);
		on.graphics.moveTo(corners[0], corners[1]);
		for (i in 1...(corners.length >> 1))
			on.graphics.lineTo(corners[2 * i], corners[2 * i + 1]);
		on.graphics.endFill();
	}

	// An arrowhead around (x, y) that points in a direction, left (-1, 0) or down (0, 1)
	public static function arrow(on:Shape, color:Int, x:Float, y:Float, to:Array<Int>):Void {
		polygon(on, color, [
			x + 12 * to[0], y + 12 * to[1],
			x - 9 * to[0] - 12 * to[1], y - 9 * to[1] + 12 * to[0],
			x - 9 * to[0] + 12 * to[1], y - 9 * to[1] - 12 * to[0]
		]);
	}

	public static function shape(into:Sprite, x = 0.0, y = 0.0):Shape {
		var shape = new Shape();
		shape.x = x;
		shape.y = y;
		into.addChild(shape);
		return shape;
	}

	public static function sprite(into:Sprite, x = 0.0, y = 0.0):Sprite {
		var sprite = new Sprite();
		sprite.x = x;
		sprite.y = y;
		into.addChild(sprite);
		return sprite;
	}

	// A centred line (or lines) of the device font, around the column x, below y
	public static function text(into:Sprite, words:String, size:Int, color:Int, x:Float, y:Float, isBold = true):TextField {
		var field = new TextField();
		field.defaultTextFormat = new TextFormat("_sans", size, color, isBold, null, null, null, null, TextFormatAlign.CENTER);
		field.width = 460;
		field.height = 4 * size + 8;
		field.x = x - 230;
		field.y = y;
		field.selectable = false;
		field.mouseEnabled = false;
		field.text = words;
		into.addChild(field);
		return field;
	}
}
