"""The drivetrain drawn as engineers draw it: discs, shafts with spring and damper, gears, dynamometers, sensors."""
