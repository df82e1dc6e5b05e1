"""`lippmann report`: speed against error of every engine, model and word length, kept and compared from run to run."""
