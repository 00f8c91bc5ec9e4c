// A game as the arcade runs it: it starts, ticks, and describes itself. It draws into `view` (480 x 360 pixels).
import flash.display.Sprite;

interface Game {
	var title:String;
	var help:String; // lines below the PLAY button
	var view:Sprite;
	function start(random:Random):Void; // draws the first picture of a new game
	function tick(keys:Keys):Bool; // one frame; false: the game is over
	function describe(state:Dynamic):Void; // adds score, scores, winner, tick and what is particular to the game
	function result():String; // headline of the scene "over"
}
