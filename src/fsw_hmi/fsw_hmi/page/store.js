// The last hour of ticks in typed arrays. Views share memory with the store: nothing is copied to draw.

export class Store {
  #columns;
  #kept;
  #start;
  #end;

  /**
   * @param names columns of a row, the time first
   * @param kept rows that are kept at least
   */
  constructor(names, kept = 3600 * 10) {
    this.names = names;
    this.#kept = kept;
    this.#columns = names.map(() => new Float64Array(2 * kept));
    this.clear();
  }

  clear() {
    this.#start = this.#end = this.#kept; // in the middle: older blocks go before, new ticks behind
  }

  get length() {
    return this.#end - this.#start;
  }

  /** Time of the newest row, NaN before the first. */
  get newest() {
    return this.length ? this.#columns[0][this.#end - 1] : NaN;
  }

  /** Add the newest row. A clock that runs backwards begins a new weld. */
  append(row) {
    if (row[0] === this.newest) return;
    if (row[0] < this.newest) this.clear();
    if (this.#end === 2 * this.#kept) this.#moveTo(0, this.#end - this.#kept);
    this.#write(this.#end++, row);
  }

  /** Add a block of rows, oldest first, before what is known; rows that are known already are left out. */
  prepend(rows) {
    const oldest = this.length ? this.#columns[0][this.#start] : Infinity;
    const older = rows.filter((row) => row[0] < oldest).slice(-Math.max(0, this.#kept - this.length));
    if (older.length > this.#start) this.#moveTo(2 * this.#kept - this.length, this.#start);
    this.#start -= older.length;
    older.forEach((row, index) => this.#write(this.#start + index, row));
  }

  /** The columns from the time `fromS` on (one row earlier, so that a line begins at the edge). */
  since(fromS) {
    const from = Math.max(this.#start, this.#search(fromS) - 1);
    return Object.fromEntries(this.names.map((name, i) => [name, this.#columns[i].subarray(from, this.#end)]));
  }

  #write(index, row) {
    for (let i = 0; i < this.#columns.length; i++) this.#columns[i][index] = row[i] ?? NaN;
  }

  #moveTo(target, start) {
    for (const column of this.#columns) column.copyWithin(target, start, this.#end);
    this.#end = target + (this.#end - start);
    this.#start = target;
  }

  #search(timeS) {
    const times = this.#columns[0];
    let [low, high] = [this.#start, this.#end];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < timeS) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
