"""JSBSim flies a finned rocket whose four fins are moved by actuators of any model."""
