"""One step of a plant each: from a state to the end of a tick, or to the first event in it."""
