"""Extensions of actuators, in the model's name behind a +: each is a module with its EXTENSION."""
