// Random numbers of a game (xorshift32), seeded once from Math.random, so that one seed of the page repeats a whole session.
class Random {
	var state:Int;

	public function new() {
		state = 1 + Std.int(Math.random() * 0x7FFFFFFE);
	}

	public function between(low:Float, high:Float):Float {
		state ^= state << 13;
		state ^= state >>> 17;
		state ^= state << 5;
		return low + (high - low) * ((state >>> 8) / 16777216);
	}

	public function sign():Int {
		return between(0, 1) < 0.5 ? -1 : 1;
	}
}
