"""A controller of one's own: one class, one line to run it.

It holds depth by force and leaves the speed alone.
"""

from fsw_control import Command, Limits, Proposal, run_controller


class DepthOnly:
    name = "depth_only"
    tolerated_sensors = ("torque", "thermocouple")

    def step(self, measurement, reference, applied, dt_s):
        if not measurement.depth_valid:
            return Proposal(applied, healthy=False, reason="no depth")
        error_mm = reference.depth_mm - measurement.depth_mm
        return Proposal(Limits().clip(Command(78.4 + 50.0 * error_mm, applied.speed_rpm), applied))

    def reset(self, applied): ...


if __name__ == "__main__":
    raise SystemExit(run_controller(DepthOnly))
