/** Values in [0, 1] over time, and a level across. */
export function Sparkline({ points, level }: { points: [number, number][]; level: number }) {
  const first = points[0][0];
  const span = Math.max(points[points.length - 1][0] - first, 1);
  const at = ([x, y]: [number, number]) => `${(((x - first) / span) * 300).toFixed(1)} ${(58 - y * 54).toFixed(1)}`;
  const line = `M${points.map(at).join("L")}`;
  return (
    <svg viewBox="0 0 300 60" preserveAspectRatio="none" role="img" aria-label="Largest probability over time">
      <path class="spark-area" d={`${line}L300 60L0 60Z`} />
      <path class="spark-line" d={line} />
      <path class="spark-level" d={`M0 ${58 - level * 54}H300`} />
    </svg>
  );
}
