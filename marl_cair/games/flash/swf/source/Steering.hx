// The four keys of Multitask in one frame. Opposite keys cancel out, so two tasks listen to opposite keys held together.
class Steering {
	public var x:Int; // -1 left, 1 right
	public var y:Int; // -1 up, 1 down
	public var leftAndRight:Bool;
	public var upAndDown:Bool;

	public function new(keys:Keys) {
		var left = keys.isDown(Keys.LEFT) || keys.isDown(Keys.A);
		var right = keys.isDown(Keys.RIGHT) || keys.isDown(Keys.D);
		var up = keys.isDown(Keys.UP) || keys.isDown(Keys.W);
		var down = keys.isDown(Keys.DOWN) || keys.isDown(Keys.S);
		x = (right ? 1 : 0) - (left ? 1 : 0);
		y = (down ? 1 : 0) - (up ? 1 : 0);
		leftAndRight = left && right;
		upAndDown = up && down;
	}
}
