// What the server says to the page (fsw_hmi/frames.py, reports_ros.py, limits.py), and what its modules say to each
// other; for the type checker only.

/** uPlot is a script of its own. */
type Plot = import("uplot");

type Level = "" | "good" | "attention" | "low" | "medium" | "high";
type Value = number | null;
type Maybe = Value | undefined;
type Pair = [Value, Value];
/** Values at one time, by column. */
type Values = Record<string, Value | undefined>;
type Row = Value[];
/** Values along a trend, by column. */
type Columns = Record<string, ArrayLike<Value>>;

interface Limit {
  range: [number, number];
  /** within which it is to be kept by the rule book: absolute, or about its set-point */
  kept?: { low: Value; high: Value; of_aim: boolean }[];
  /** columns of further sensors of the quantity */
  others?: { key: string; name: string }[];
  dead_band: Value;
  deviation?: number;
  warn?: Pair;
  trip?: Pair;
}
/** By quantity. */
type Limits = Record<string, Limit>;

interface Reference {
  depth_mm: [number, number];
  temperature_c: [number, number];
  rate_depth_mm_per_s: number;
  rate_temperature_c_per_s: number;
}
interface SetPoints {
  depth_mm: number;
  temperature_c: number;
}
interface Hello {
  t: "hello";
  session: string;
  resume: string;
  server_s: number;
  login: "token" | "password";
  columns: string[];
  pages: string[];
  limits: Limits;
  reference: Reference;
}
interface Health {
  name: string;
  ready: boolean;
  healthy: boolean;
  inhibited: boolean;
  reason: string;
  why: string;
  missing_sensors: string[];
  latency_ms: Value;
  latency_max_ms: Value;
  missed: number;
  late: number;
  rejected: number;
}
interface State {
  t: "state";
  known: boolean;
  /** of known heat that the controller in command uses, 0 to 1; null: it knows none */
  known_heat_share: Value;
  /** whether another supervisor reports that it stands ready */
  standby: boolean;
  target_controller: string;
  actual_controller: string;
  target_mode: string;
  actual_mode: string;
  reason: string;
  cause: number;
  by: string;
  stop_cause: number;
  acknowledged: boolean;
  controllers: Health[];
  interlocks: { name: string; level: string }[];
}
interface Programme {
  t: "progress";
  state: string;
  phase: string;
  angle_deg: Value;
  length_mm: Value;
  time_left_s: Value;
  depth_mm: Value;
  temperature_c: Value;
  left: boolean;
  way_back_s: Value;
}
type BagState = "none" | "recording" | "incomplete" | "paused" | "failed" | "silent" | "closed" | "closed_with_gaps";
/** What is known of the recording; the last gap in the weld's time. */
interface RecordingReport {
  t: "recording";
  state: BagState;
  bag: string;
  bytes: number;
  missing: number;
  gap: [number, number] | null;
}
interface Control {
  t: "control";
  holder: { name: string; session: string } | null;
  you: boolean;
  request: { name: string; session: string; left_s: number; you: boolean } | null;
  name: string;
  authenticated: boolean;
  ticket: string;
  may_stop: boolean;
  note: string;
  note_code: string;
}
type Priority = "low" | "medium" | "high";
interface Alarm {
  id: string;
  /** `what` and `why` in one. */
  text: string;
  what: string;
  why: string;
  consequence: string;
  advice: string;
  priority: Priority;
  state: "active" | "acknowledged" | "cleared" | "shelved";
  /** in the order of raising */
  number: number;
  count: number;
  first_out: boolean;
  first: string;
  first_s: number;
  raised_s: number;
  shelved: string;
  shelved_until_s: Value;
}
/** Whether commands reach the machine. */
interface Reach {
  ok: boolean | null;
  text: string;
}
interface Action {
  server_s: number;
  who: string;
  action: string;
  outcome: string;
  code: string;
  message: string;
}
/** Set-points to come, or a controller's plan: values by quantity, at times of the weld, and as `quantity:deviation` the
 * standard deviations of what will be measured. */
type Ahead = { time_s: number[] } & { [quantity: string]: number[] | undefined };
/** What the server finds wrong with a quantity. */
type Flag = { level: "medium" | "high"; kind: "trip" | "essential" | "warn" | "quality" | "error" | "deviation"; text: string };
/** By quantity; most have nothing. */
type Flags = Record<string, Flag | undefined>;
/** How far a safe stop has come; without figures where its ramp or the force are not known. */
type StopProgress = { kind: "falling" | "safe" | "not_falling" | "unknown"; share?: number; safe_kn?: number; due_kn?: number; left_s?: number };
type Tick = { t: "tick"; server_s: number; row: Row; flags: Flags; stop: StopProgress | null };
type Frame =
  | Hello
  | State
  | Programme
  | RecordingReport
  | Control
  | Tick
  | (Account & { t: "account" })
  | (Headline & { t: "headline" })
  | Heat
  | { t: "history"; rows: Row[] }
  | { t: "beat"; tick_age_s: Value }
  | ({ t: "prediction"; controller: string } & Ahead)
  | { t: "alarms"; alarms: Alarm[]; reach: Reach; attainable: SetPoints | null }
  | { t: "actions"; actions: Action[] };
/** Heat known from earlier welds, by angle; empty without. */
interface Heat {
  t: "heat";
  type: string;
  angle_deg: number[];
  heat_kw: number[];
  deviation_kw: number[];
}
interface Answer {
  outcome: string;
  /** Kind of the answer; none of those that the page makes itself. */
  code?: string;
  message: string;
}
interface Link {
  kind: "connecting" | "live" | "lost" | "stale";
  text: string;
}
/** What becomes of a connection: a frame, a time of the server that is news, another state. */
interface Listener {
  frame(frame: Frame): void;
  fresh(serverS: number): void;
  linked(link: Link): void;
}
type Ask = (text: string, request: string, fields?: object) => Promise<Answer>;

/** Whether the weld is good, and if not, what is worst. */
interface Headline {
  level: Level;
  text: string;
  detail?: string;
  /** The alarm that it is of; empty: of none. */
  alarm?: string;
  /** What to do. */
  next?: string;
  /** What to do once the programme is over; empty before. */
  after?: string;
}
interface Choice {
  value: string;
  text: string;
  remark?: string;
}
interface Form {
  title: string;
  fields?: { root: HTMLElement }[];
  summary?: () => string;
  /** Why what is filled in is certain to be refused; empty where it is not. */
  lack?: () => string;
  confirm: string;
  run: () => Promise<Answer | void>;
  /** Called when the form is gone, whatever became of it. */
  closed?: () => void;
}
/** A quantity as the page shows it: `aim` is the column that it should follow. */
interface Spec {
  key: string;
  name: string;
  unit: string;
  digits: number;
  aim: string;
  aimName: string;
  /** how fast a set-point may move */
  rampPerS?: number;
  big?: boolean;
  /** raster of a trend's scale, and its smallest extent */
  step: number;
  span: number;
}
interface Line {
  key: string;
  stroke: string;
  width: number;
  dash?: number[];
  /** in the heading of the trend */
  name?: string;
}
interface Chart {
  key: string;
  spec: Spec;
  plot: HTMLElement;
  reading: HTMLElement;
  unit: HTMLElement;
  named: Line[];
  keys: string[];
  extra: number[];
  uplot: Plot;
}
/** How trends are drawn. */
interface Drawing {
  lines(key: string): Line[];
  label(timeS: number): string;
  /** where the axis is labelled, or steps of which one is taken */
  splits?(min: number, max: number): number[];
  incrs?: number[];
  zoom(range: [number, number]): void;
  /** first and last time that there is */
  ends(): [number, number];
  overlay(uplot: Plot, key: string): void;
}
/** A place on the way around the canister, and what was there. */
interface Spot {
  rank: number;
  text: string;
  timeS: number;
}
/** A place outside a limit, as the server judges. */
interface Mark {
  level: Level;
  text: string;
  time_s: number;
  lasts_s: number;
  from_deg: Value;
  to_deg: Value;
}
/** The judgement of a weld, or of a weld so far. */
interface Account {
  verdict: "accept" | "review" | "reject";
  level: Level;
  rule: string;
  text: string;
  detail: string;
  marks: Mark[];
}
interface Stretch {
  from: number;
  to: number;
  worst: Spot;
}
/** A recorded weld. */
interface Weld {
  n: number;
  name: string;
  duration_s: number;
  start_s: Value;
  columns: string[];
  rows: any[][];
  events: { time_s: number; text: string }[];
  account: Account;
  problems: string[];
}
