"""Which part is damaged: the name, its evidence, and the verdict of the channels of a bearing."""
