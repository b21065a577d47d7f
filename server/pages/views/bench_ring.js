// The last minutes of a stream in arrays of fixed size: what is drawn thirty times a second makes no garbage.

export const AXES = 6;

export class Ring {
  /** Room for so many envelopes; the oldest make room for new ones. */
  constructor(room = 8192) {
    this.room = room;
    this.to = new Float64Array(room);
    this.from = new Float64Array(room);
    this.low = new Float32Array(room * AXES);
    this.high = new Float32Array(room * AXES);
    this.mean = new Float64Array(AXES);
    this.latest = new Float64Array(AXES).fill(NaN);
    this.over = new Uint8Array(room);
    this.clear();
  }

  clear() {
    this.begin = 0;
    this.count = 0;
    this.latest.fill(NaN);
    this.mean.fill(NaN);
  }

  /** Place of the i-th oldest envelope in the arrays. */
  at(i) {
    const k = this.begin + i;
    return k < this.room ? k : k - this.room;
  }

  get firstS() { return this.count ? this.from[this.begin] : NaN; }
  get lastS() { return this.count ? this.to[this.at(this.count - 1)] : NaN; }

  push(from, to, least, most, over) {
    if (this.count === this.room) this.begin = this.at(1);
    else this.count++;
    const k = this.at(this.count - 1);
    this.from[k] = from;
    this.to[k] = to;
    this.over[k] = over ? 1 : 0;
    for (let i = 0; i < AXES; i++) {
      // A component that is no number is null on the wire.
      this.low[k * AXES + i] = least[i] ?? NaN;
      this.high[k * AXES + i] = most[i] ?? NaN;
    }
  }

  /** Take the envelopes of a trace message that are new; returns how many readings they hold. */
  take(body) {
    const n = body.to_s.length;
    // The bench's clock went back: another run of the stream.
    if (n && this.count && body.to_s[n - 1] < this.lastS - 5) this.clear();
    let readings = 0;
    for (let k = 0; k < n; k++) {
      if (this.count && body.to_s[k] <= this.lastS) continue;
      this.push(body.from_s[k], body.to_s[k], body.least[k], body.most[k], body.overload[k]);
      readings += body.count[k];
      for (let i = 0; i < AXES; i++) {
        this.latest[i] = body.latest[k][i] ?? NaN;
        this.mean[i] = (body.mean ?? body.latest)[k][i] ?? NaN;
      }
    }
    return readings;
  }

  /** The first envelope that ends at a time or later. */
  find(t) {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.to[this.at(middle)] < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Whether any reading since a time was beyond the cell's range. */
  overloadedSince(t) {
    for (let i = this.count - 1; i >= 0; i--) {
      const k = this.at(i);
      if (this.to[k] < t) return false;
      if (this.over[k]) return true;
    }
    return false;
  }
}

/** Readings a second over the last seconds, in buckets of a quarter of one. */
export class Rate {
  constructor(seconds = 3) {
    this.buckets = new Float64Array(seconds * 4);
    this.began = null;
    this.last = null;
  }

  add(readings, now) {
    this.turn(now);
    this.began ??= now;
    this.buckets[this.last % this.buckets.length] += readings;
  }

  turn(now) {
    const bucket = Math.floor(now / 250);
    if (this.last === null || bucket - this.last >= this.buckets.length) {
      this.buckets.fill(0);
      if (this.last !== null) this.began = null;
    } else {
      for (let k = this.last + 1; k <= bucket; k++) this.buckets[k % this.buckets.length] = 0;
    }
    this.last = bucket;
  }

  /** Null where nothing came, or not for long enough to say. */
  hz(now) {
    if (this.began === null) return null;
    this.turn(now);
    if (this.began === null) return null;
    // The bucket of this moment is not full yet.
    let sum = 0;
    for (let k = 0; k < this.buckets.length; k++) if (k !== this.last % this.buckets.length) sum += this.buckets[k];
    const span = Math.min(now - this.began, (this.buckets.length - 1) * 250) / 1000;
    return span > 0.6 ? sum / span : null;
  }
}
