"""V_eq and TT by the method of the thesis (sections 5.2.2 and 5.2.3)."""
