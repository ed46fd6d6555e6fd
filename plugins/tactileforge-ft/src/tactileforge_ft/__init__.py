"""Force-torque sensors for tactileforge."""
