"""A robot that puts things down, in mujoco: what comes of a plan where bodies have mass and rub."""
