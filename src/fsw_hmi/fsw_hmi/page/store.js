// The last hour of ticks, by column.

export class Store {
  /**
   * @param {string[]} names columns of a row, the time first
   * @param {number} kept rows that are kept at least
   */
  constructor(names, kept = 3600 * 10) {
    this.names = names;
    this.kept = kept;
    /** @type {number[][]} */
    this.columns = names.map(() => []);
  }

  /** Time of the newest row, NaN before the first. */
  get newest() {
    const [times] = this.columns;
    return times.length ? times[times.length - 1] : NaN;
  }

  /** Add the newest row. A clock that runs backwards begins a new weld. */
  append(row) {
    if (row[0] === this.newest) return;
    if (row[0] < this.newest) this.columns = this.names.map(() => []);
    this.columns.forEach((column, i) => column.push(row[i] ?? NaN));
    const surplus = this.columns[0].length - this.kept;
    if (surplus > this.kept / 10) this.columns.forEach((column) => column.splice(0, surplus)); // seldom: it moves all
  }

  /** Add a block of rows, oldest first, before what is known; rows that are known already are left out. */
  prepend(rows) {
    const oldest = this.columns[0][0] ?? Infinity;
    const older = rows.filter((row) => row[0] < oldest);
    this.columns = this.columns.map((column, i) => older.map((row) => row[i] ?? NaN).concat(column));
  }

  /** The columns from the time `fromS` on (one row earlier, so that a line begins at the edge). */
  since(fromS) {
    const from = Math.max(0, countBefore(this.columns[0], fromS) - 1);
    return Object.fromEntries(this.names.map((name, i) => [name, this.columns[i].slice(from)]));
  }
}

/** How many of the times, which are in order, are before `timeS`. @param {number[]} times @param {number} timeS */
export function countBefore(times, timeS) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < timeS) low = middle + 1;
    else high = middle;
  }
  return low;
}
