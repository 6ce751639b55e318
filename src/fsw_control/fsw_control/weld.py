"""Constants that all packages share: the paper's operating point, drive limits, the tick."""

#: Time between two ticks, paper (36).
TICK_S = 0.1
TICK_NS = 100_000_000
#: Operating point, paper (15); at this speed the power is 43.6 kW.
DEPTH_MM, TEMPERATURE_C = 2.66, 816.4
FORCE_KN, SPEED_RPM = 78.4, 407.576
#: Bounds, chosen: the paper draws limits but does not give them.
FORCE_MIN_KN, FORCE_MAX_KN = 60.0, 95.0
SPEED_MIN_RPM, SPEED_MAX_RPM = 300.0, 500.0
#: Largest change per tick, paper, section IV.
FORCE_STEP_KN, SPEED_STEP_RPM = 1.0, 3.0
#: Largest depth error that counts as good; chosen, about the size of the paper's step disturbance.
QUALITY_DEPTH_MM = 0.1
#: Temperature range without weld defects and tool damage: lup.lub.lu.se/record/1961682.
QUALITY_TEMPERATURE_MIN_C, QUALITY_TEMPERATURE_MAX_C = 790.0, 910.0
