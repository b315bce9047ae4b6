"""Units, rigs and plans that do not exist, honestly simulated: recording, plan and truth."""
