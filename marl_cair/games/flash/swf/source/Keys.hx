// Keys that are down in this frame. A tap that begins and ends between two frames counts as down for one frame.
class Keys {
	public static inline var ENTER = 13;
	// Arrows and W, A, S, D by Flash key code
	public static inline var LEFT = 37;
	public static inline var UP = 38;
	public static inline var RIGHT = 39;
	public static inline var DOWN = 40;
	public static inline var A = 65;
	public static inline var D = 68;
	public static inline var S = 83;
	public static inline var W = 87;

	var held = new Map<Int, Bool>();
	var tapped = new Map<Int, Bool>();

	public function new() {}

	// True for a new press, false for the keyboard's automatic repeat
	public function press(code:Int):Bool {
		var isNew = !held.exists(code);
		held.set(code, true);
		tapped.set(code, true);
		return isNew;
	}

	public function release(code:Int):Void {
		held.remove(code);
	}

	public function endFrame():Void {
		tapped = new Map<Int, Bool>();
	}

	public function isDown(code:Int):Bool {
		return held.exists(code) || tapped.exists(code);
	}
}
