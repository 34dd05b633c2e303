"""Poses of Ŝ(r, f) on a level region, by the formula."""

import numpy as np
import pinocchio as pin


def placement_pose(face, contact, angle):
    """T(R_z(θ), (x, y, z_r)) · fT_o."""
    return pin.SE3(pin.utils.rotate("z", angle), np.asarray(contact)) * face.T_face_object
