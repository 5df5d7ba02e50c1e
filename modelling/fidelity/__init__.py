"""The XiL fidelity of a test bed (R_SD, R_RVM, R_MU, R_XiL; Eqs. 13 to 23) from reference and test signals."""
