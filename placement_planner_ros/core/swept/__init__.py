"""All that an arm sweeps along a path, against the points of a cloud that has just come."""
