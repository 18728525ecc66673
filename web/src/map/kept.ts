// What is made for the map stays as long as what it is made from: what is new is uploaded again, at every move of the camera.

export class Kept<T> {
  private from: readonly unknown[] | null = null;
  private made: T | undefined;

  /** What `make` gave for the same things, in the same order; new for others. */
  of(from: readonly unknown[], make: () => T): T {
    if (this.from?.length !== from.length || this.from.some((thing, k) => thing !== from[k])) {
      this.made = make();
      this.from = from;
    }
    return this.made as T;
  }
}
