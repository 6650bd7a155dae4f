"""One module per command, each with ``configure(parser)`` and ``run(options) -> exit code``.

The module's docstring is the command's help text. Heavy imports belong inside ``run``.
"""

COMMANDS: dict[str, str] = {
    "demo": "the main job in short: the paper's joint simulated, identified, predicted; one real recording",
    "simulate": "write a campaign of simulated recordings of the single-joint rig or the six-axis arm",
    "inspect": "what a campaign holds, and what is wrong with its channels",
    "new": "make a campaign from a lab's data files",
    "import": "make a campaign from a public data set",
    "identify": "stiffness, inertia, damping and modes with intervals, from hammer hits or torque and angles",
    "predict": "arm vibration from the motor's torque or current, written per run",
    "diagnose": "what physics the base model left out, where, how large and how sure",
    "rehearse": "which effects would be seen and named with the recordings you have, on a simulation of your own rig",
    "conceal": "write recordings in which an effect is concealed, its truth sealed",
    "prove": "diagnose concealed recordings, then open the seal and score",
    "confirm": "re-run held-out experiments in MuJoCo with and without the diagnosed effect",
    "arm": "an arm of several elastic joints: list, build, show, solve, identify",
    "model": "check your own simulation against a campaign: model map robot.xml CAMPAIGN",
    "reproduce": "the paper's figures and tables beside its numbers",
    "gate": "accuracy gates: claims with bounds, measured anew, for CI",
    "compare": "what changed between two results, against their intervals",
    "watch": "at the bench: good or repeat after each take, and what is still missing",
    "sensitivity": "how much each parameter matters to what users care about",
    "selfcheck": "the simulator's own error against the closed form",
}

MODULES: dict[str, str] = {"import": "import_"}  # commands whose module can't carry their name
