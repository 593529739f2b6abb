"""JSBSim flies a finned rocket whose four fins are moved by EMCAS4.fmu."""
