import { useStore } from "../state/store";

const FOOT_M = 0.3048;
const WIDEST_PIXELS = 110;

/** The longest of 1, 2, 5, 10, ... that fits. */
export function roundLength(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((digit) => digit * power).find((length) => length <= most) ?? power;
}

/** Exact in the middle of the map: a picture in perspective has no scale of its own. */
export function ScaleBar({ pixel_m }: { pixel_m: number }) {
  const units = useStore((state) => state.units);
  if (!(pixel_m > 0)) return null;
  const unit_m = units === "metres" ? 1 : FOOT_M;
  const length = roundLength((WIDEST_PIXELS * pixel_m) / unit_m);
  const pixels = (length * unit_m) / pixel_m;
  return (
    <div class="scale" title="In the middle of the map">
      <span style={{ width: `${pixels}px` }} />
      {length} {units === "metres" ? "m" : "ft"}
    </div>
  );
}
