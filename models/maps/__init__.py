"""RMS maps over extent and depth of a defect: plan, nodes, build, refine, check, file."""
