"""One package a sensor, all of one shape (`measure` -> Measurement); none imports another."""
