"""What is to be simulated: scenarios, their files, and what they refuse."""
