"""Extensions of actuators, named after a + in a model's name; the module of an extension defines EXTENSION.

Other modules are parts of extensions: declaration (of all), currents, pole_pairs and status (of several), fault_list
and monitors (of faults), homing_run (of homing). FMUs alone have halves and torque.
"""
