"""How the chaser moves relative to the target, and how uncertainty grows with it: no sensor, no filter."""
