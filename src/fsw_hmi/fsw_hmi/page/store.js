// The last hour of ticks, by column.
import { known } from "./format.js";

const KEPT = 3600 * 10; // rows at least

export class Store {
  /** @param {string[]} names columns of a row, the time first */
  constructor(names) {
    this.names = names;
    /** @type {Value[][]} */ this.columns = names.map(() => []);
  }

  /** Time of the newest row, NaN before the first. */
  get newest() {
    return this.columns[0].at(-1) ?? NaN;
  }

  /** Add the newest row. */
  append(/** @type {Row} */ row) {
    if (row[0] === this.newest) return;
    this.columns.forEach((column, i) => column.push(row[i] ?? null));
    const surplus = this.columns[0].length - KEPT;
    // seldom: it moves all
    if (surplus > KEPT / 10) this.columns.forEach((column) => column.splice(0, surplus));
  }

  /**
   * Add a block of rows, oldest first, before what is known; rows that are known already are left
   * out.
   */
  prepend(/** @type {Row[]} */ rows) {
    const oldest = this.columns[0][0] ?? Infinity;
    const older = rows.filter(([time]) => time !== null && time < oldest);
    this.columns = this.columns.map((column, i) =>
        older.map((row) => row[i] ?? null).concat(column));
  }

  /**
   * The columns from the time `fromS` on (one row earlier, so that a line begins at the edge).
   * @returns {Columns}
   */
  since(/** @type {number} */ fromS) {
    const from = Math.max(0, this.columns[0].findLastIndex((time) => known(time) && time < fromS));
    return Object.fromEntries(this.names.map((name, i) => [name, this.columns[i].slice(from)]));
  }
}
