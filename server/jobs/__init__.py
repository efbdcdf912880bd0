"""Background work: one worker program, started as a child process by a runner."""
