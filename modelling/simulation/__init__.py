"""Time integration in parts: functions, steps, native and virtual machine, start states, the adaptive check."""
