"""A control law of your own: PD with gravity compensation for a fully actuated robot.

    skywright run waypoints --robot othex --set mission.law=examples/my_law.py:step

Arguments are records of skywright.core.types: `par` (bandwidths from the robot file), `mem`
(memory; `mem.user` is free), `ref` (what to follow), `est` (what may be seen), `body` (nominal
rigid body) and `cmd` (to fill). SI and radians; W is the world, B the body.

Without the decorator it is a plain Python function: then print() and a debugger work, and the run
is slower.
"""

from numba import njit


@njit
def step(par, mem, ref, est, body, cmd):
    if ref.active < 0.5:  # motors off
        return

    # Force: mass * (a_des + kd * velocity error + kp * position error + gravity), in W.
    kp = par.wn_p**2
    kd = 2.0 * par.zeta_p * par.wn_p
    f_W = body.mass * (ref.a_WB + kd * (ref.v_WB - est.v_WB) + kp * (ref.p_WB - est.p_WB))
    f_W[2] += body.mass * body.gravity

    # The rotors make forces in B: f_B = R_WB^T f_W.
    for i in range(3):
        cmd.f_B[i] = 0.0
        for j in range(3):
            cmd.f_B[i] += est.R_WB[j, i] * f_W[j]

    # Attitude error e = 1/2 [R^T R_des - R_des^T R]_vee, column by column.
    e_R = (
        0.5 * (est.R_WB[:, 2] * ref.R_WB[:, 1] - ref.R_WB[:, 2] * est.R_WB[:, 1]).sum(),
        0.5 * (est.R_WB[:, 0] * ref.R_WB[:, 2] - ref.R_WB[:, 0] * est.R_WB[:, 2]).sum(),
        0.5 * (est.R_WB[:, 1] * ref.R_WB[:, 0] - ref.R_WB[:, 1] * est.R_WB[:, 0]).sum(),
    )

    # Torque about the origin of B: the force acts at the centre of mass p_BC.
    kp_R = par.wn_R**2
    kd_R = 2.0 * par.zeta_R * par.wn_R
    c, f = body.p_BC, cmd.f_B
    cmd.t_B[0] = c[1] * f[2] - c[2] * f[1]
    cmd.t_B[1] = c[2] * f[0] - c[0] * f[2]
    cmd.t_B[2] = c[0] * f[1] - c[1] * f[0]
    for i in range(3):
        acceleration = kp_R * e_R[i] + kd_R * (ref.w_WB_B[i] - est.w_WB_B[i])
        cmd.t_B[i] += body.I_B[i, i] * acceleration

    # The arm follows its reference; the servos take velocities.
    for j in range(body.n_joints):
        cmd.qd[j] = ref.qd[j] + par.k_arm * (ref.q[j] - est.q[j])
