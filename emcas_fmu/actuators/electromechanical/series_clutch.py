"""Clutch actuator, series: the nonlinear actuator with a load-holding clutch between motor and screw.

    J_r dw/dt = T_m - C_m sgn w - b_m w - e L        e = 1/forward where L w > 0, else backward = 0

The clutch passes the motor's torque both ways and opens for what comes from the load: that it takes to the housing,
with friction (a bidirectional no-back). A load that acts with the motion thus meets a screw that follows the motor,
without any torque on it: L is what the screw turns against, and the clutch makes heat of L w. In the equations it is a
screw whose efficiency in backward drive is 0 (:mod:`emcas_fmu.physics.screw`), with its exact stick and slip. The
rotor's kinetic energy, which is no load's, still comes back where the drive brakes it. A clutch that slips under too
much torque, and the lost motion of one that turns over, are left out.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from ...variables import tunable
from .. import capabilities
from ..declaration import PlantFault, with_outputs
from . import lossy_screw, nonlinear

LOSS = replace(lossy_screw.LOSS, description="power that clutch and screw turn into heat under load")
FAULTS = (
    PlantFault("clutch_engaged", "the clutch does not open: the load drives the motor", lambda ops, p, amounts: {
        "efficiency.backward": amounts.share}, (
            tunable("share", "1", 0.0, 1.0, "of the load's torque that gets through to the motor"),)),
)
ACTUATOR = replace(
    lossy_screw.with_losses(nonlinear.ACTUATOR),
    name="series-clutch",
    title="clutch actuator: the nonlinear one with a clutch between motor and screw that no load drives",
    origin="Section 1.1.1.2 of the thesis of Yerlikaya (2016): the first actuator with a clutch, so that loads which "
           "act with the motor return no energy. It gives no numbers: those of the clutch are engineering estimates, "
           "the others are the nonlinear set's.",
    outputs=with_outputs(nonlinear.ACTUATOR.outputs, (LOSS,)),
    parameters=nonlinear.ACTUATOR.parameters + lossy_screw.PARAMETERS,
    rules=nonlinear.ACTUATOR.rules + lossy_screw.rules(nonlinear.ACTUATOR),
    faults=FAULTS,
    provides=nonlinear.ACTUATOR.provides - {capabilities.SCREW_LOAD},
    reference=None,
    modules=(sys.modules[__name__], lossy_screw, *nonlinear.EQUATIONS),
)
