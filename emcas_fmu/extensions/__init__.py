"""Extensions of actuators, named after a + in a model's name; the module of an extension defines EXTENSION."""
