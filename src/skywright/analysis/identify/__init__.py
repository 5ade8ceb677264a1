"""Parameters of a robot from a recorded flight: `skywright identify`.

Given the signals, the model is linear in its parameters. Every column is filtered alike, and the
parameters follow from least squares on the predicted accelerations. A parameter that the flight
does not excite has a wide confidence interval; it keeps the robot file's value and is reported.
"""
