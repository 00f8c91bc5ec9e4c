// One of the four tasks of Multitask. It draws into `view`, whose origin is the centre of a panel of 234 x 162 pixels.
import flash.display.Sprite;

interface Task {
	var view:Sprite;
	function tick(keys:Steering, hardness:Float):Bool; // hardness grows slowly from 1; false: the task failed
	function describe():Dynamic;
}
