// What the server says to the page (fsw_hmi/frames.py, reports_ros.py, limits.py), for the type checker only.

/** uPlot is a script of its own. */
declare const uPlot: typeof import("uplot").default;

type Pair = [number | null, number | null];
type Values = Record<string, any>;
/** By quantity. */
type Limits = Record<string, { range: [number, number]; quality?: Pair; dead_band?: number; warn?: Pair; trip?: Pair }>;

interface Hello {
  session: string;
  server_s: number;
  commands: boolean;
  emulator: boolean;
  columns: string[];
  limits: Limits;
  reference: { depth_mm: [number, number]; temperature_c: [number, number]; rate_depth_mm_per_s: number; rate_temperature_c_per_s: number };
  safe?: { force_kn: number; rate_kn_per_s: number } | null;
  [more: string]: any;
}
interface Health {
  name: string;
  ready: boolean;
  healthy: boolean;
  inhibited: boolean;
  reason: string;
  latency_ms: number | null;
  latency_max_ms: number | null;
  missed: number;
  late: number;
  rejected: number;
}
interface State {
  known: boolean;
  target_controller: string;
  actual_controller: string;
  target_mode: string;
  actual_mode: string;
  reason: string;
  requested_by: string;
  since_s: number | null;
  acknowledged: boolean;
  controllers: Health[];
  interlocks: string[];
  parts: { name: string; level: string; text: string }[];
}
interface Programme {
  state: string;
  phase: string;
  angle_deg: number | null;
  length_mm: number | null;
  time_left_s: number | null;
  depth_mm: number | null;
  temperature_c: number | null;
  left: boolean;
  way_back_s: number | null;
}
interface Control {
  holder: { name: string; session: string } | null;
  you: boolean;
  authenticated: boolean;
  may_stop: boolean;
  [more: string]: any;
}
/** Set-points to come, or a controller's plan: values by quantity, at times of the weld. */
interface Ahead {
  time_s: number[];
  [key: string]: any;
}
interface Answer {
  outcome: string;
  message: string;
}
interface Verdict {
  level: string;
  text: string;
  detail?: string;
}
interface Field {
  root: HTMLElement;
  readonly value: any;
  input?: any;
  use?: (shown: boolean, low?: number, high?: number, unit?: string) => void;
}
interface Form {
  title: string;
  fields?: Field[];
  summary?: () => string;
  confirm: string;
  run: () => Answer | Promise<Answer>;
  /** Called when the form is gone, whatever became of it. */
  closed?: () => void;
}
/** A quantity as the page shows it: `aim` is the column that it should follow. */
interface Spec {
  key: string;
  name: string;
  unit: string;
  digits: number;
  aim?: any;
  aimName?: string;
  /** how fast a set-point may move */
  rampPerS?: number;
  big?: boolean;
  step?: any;
  span?: any;
}
/** Part of the way around the canister. */
interface Stretch {
  from: number;
  to: number;
  worst: { rank: number; text: string; timeS: number };
}
