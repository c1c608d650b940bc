"""From images and depth to a height map, to wrinkles, to a flattening target; arrays, no Drake."""
