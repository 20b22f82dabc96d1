"""Truth, made without the filter's own model: orbits integrated, detectors imaged, faults injected."""
