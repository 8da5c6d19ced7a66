"""Where each part of the error-state stands in its vector.

Position and velocity are those of the IMU, in map; the attitude's error is a rotation in map axes; the biases are in
base_link axes; then the slow error of the attitude topic, map axes, and the scale error of the DVL.
"""

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO_BIAS, ACCELEROMETER_BIAS, TOPIC = slice(9, 12), slice(12, 15), slice(15, 18)
SCALE = 18
STATES = 19
