"""Parameters of a robot from a recorded flight: `skywright identify`.

The model is linear in its parameters once the signals are known, so every column is filtered alike
and the parameters follow from least squares on the predicted accelerations. What a flight did not
excite is found by the size of its confidence interval, kept at the robot file's value and said.
"""
