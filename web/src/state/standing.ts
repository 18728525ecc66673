// How a drone stands: what it sees counts only where it is "ok".

import type { Drone } from "../api/contract";

export type Standing = Drone["status"] | "left-out";

export const standingOf = ({ status, left_out }: Drone): Standing => (left_out ? "left-out" : status);
