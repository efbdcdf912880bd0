"""What is kept: run folders that outlive the program."""
