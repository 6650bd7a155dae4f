"""A second engine of concealed campaigns: nothing of it is shared with ``sim.concealed``, with MuJoCo or with who explains.

What both engines have in common is the format of campaigns and the seal. The equations, the laws of friction, play and
hysteresis, the excitation, the noise and the file plan are this package's own, so that a diagnosis can be scored on
physics that neither its own laws nor the other engine's were written beside.

Reading order: ``physics`` (the constants of one joint), ``layout`` and ``equations`` (its laws and RK4), ``rig``
and ``setup`` (which joints and experiments),
``excitation`` and ``takes`` (what is done to them), ``devices``, ``sampling`` and ``sensing`` (what is recorded),
``effect`` and the ``effects_*`` (what can be concealed), ``noise`` and ``sizing`` (how visible it is), ``intent`` (which
case conceals what), ``case``, ``paperwork`` and ``production`` (one case, its files, a whole draw).

Conventions where the format leaves them open:

- Friction is tanh(w/w_e) at the load; tanh or LuGre at the motor. Load-dependent friction is mu |T_S| against the motor.
- Play is a hard dead zone, centred at the start of a horizontal run, in contact on a vertical rig.
- Hysteresis is added to the stiffness; structural damping is six Maxwell elements with c = 0 and K(w0) kept.
- T_S = K (q_s - q + e) with e the transmission error; its phase counts the motor's angle from the horizontal.
- A torque gain is actual over logged; a sensor's gain is recorded over true.
- A late device's sample stamped t is the true value at (t - delay)/(1 + 1e-6 ppm).
- Where there is an accelerometer on a horizontal rig its axis is level: it reads no gravity.
"""
