"""Extensions of actuators, named after a + in a model's name; the module of an extension defines EXTENSION.

halves.py instead defines CONTROLLER and PLANT; these and torque.py exist only in FMUs. Other modules are parts of
extensions: declaration (of all), currents, pole_pairs, status and homing_run (of several), fault_list and monitors (of
faults).
"""
