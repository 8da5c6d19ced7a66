"""What a cell of the elevation grid and a voxel of the evidence remember."""

import numpy as np

TILE_BITS = 6
TILE = 1 << TILE_BITS  # cells along a side of a tile; a power of two, so that tiles coarsen evenly

# Of the points of a cell, each carried along the slope of the surface to the cell's centre, with its elevation z_i, the
# variances of z_i by its own noise n_i and by its pose p_i, and w_i = 1 / (n_i + p_i). Index s: of one sweep;
# r_st: correlation of the path's errors at two sweeps. What needs no more than seven digits has no more.
CELL = np.dtype(
    [
        ("count", np.int32),  # points
        ("sweeps", np.int32),  # sweeps that saw the cell
        ("z", np.float64),  # sum w_i z_i / W, m
        ("first", np.float64),  # s, when the first sweep began
        ("last", np.float64),  # s, and the last
        ("weight", np.float32),  # W = sum w_i, 1/m^2
        ("noise", np.float32),  # sum w_i^2 n_i: noise / W^2 is the variance of z by what every point errs for itself
        ("pose", np.float32),  # sum_st P_s P_t r_st with P = sum w_i sqrt p_i: pose / W^2 is the variance of z by poses
        ("leading", np.float32),  # sum_s P_s r_fs: what all sweeps share with the first
        ("lasting", np.float32),  # sum_s P_s r_sl: and with the last
        ("within", np.float32),  # sum_s sum w_i (z_i - z_s)^2
        ("within_expected", np.float32),  # what that is on average if the noise is what it claims
        ("between", np.float32),  # sum_s W_s (z_s - z)^2
        ("between_noise", np.float32),  # sum_s noise_s / W_s
        ("between_pose", np.float32),  # sum_s pose_s / W_s
        ("intensity", np.float32),  # weighted mean, 0..255
    ],
    align=True,
)

# The same while the points of one sweep are summed up.
OPEN_CELL = np.dtype(
    [(name, np.int32 if CELL[name] == np.int32 else np.float64) for name in CELL.names or ()], align=True
)

# Of the points of a voxel; offsets are from the voxel's centre.
VOXEL = np.dtype(
    [
        ("key", np.int64),  # packed index of the voxel, -1 when the slot is free
        ("count", np.int32),  # points
        ("profiles", np.int32),  # profiles that hit it
        ("first", np.int32),  # lowest and highest number of a profile that hit it
        ("last", np.int32),
        ("through", np.int32),  # profiles whose light or view passed near the middle of its points and went on
        ("pierced", np.int32),  # those that passed so near that even a thin cable would have been hit
        ("passer", np.int32),  # the last of either
        ("piercer", np.int32),
        ("x", np.float32),  # sums of offsets, m, and of their products, m^2
        ("y", np.float32),
        ("z", np.float32),
        ("xx", np.float32),
        ("xy", np.float32),
        ("xz", np.float32),
        ("yy", np.float32),
        ("yz", np.float32),
        ("zz", np.float32),
    ],
    align=True,
)

# What the 3 x 3 x 3 voxels about a voxel say together.
SURROUNDING = np.dtype(
    [
        ("count", np.int32),  # points
        ("support", np.int32),  # profiles, summed over the voxels
        ("voxels", np.int32),  # voxels that were hit
        ("through", np.float32),  # profiles that would have hit it and went on, summed over the voxels
        ("several", np.bool_),  # more than one profile hit it
        ("moved", np.bool_),  # what was there is not there always, or belongs to a body that moves
        ("x", np.float32),  # centroid, m from the voxel's centre
        ("y", np.float32),
        ("z", np.float32),
        ("normal_x", np.float32),  # of the plane through the centroid, upward
        ("normal_y", np.float32),
        ("normal_z", np.float32),
        ("thickness", np.float32),  # variance of the points about that plane, m^2
    ],
    align=True,
)
