import { useCallback, useEffect, useState } from "react";
import { getCalibration, type Calibration } from "../api/calibration";
import { RequestError } from "../api/request";
import { goesOn } from "./calibrating";

/** So often a calibration under way is asked after. */
const EVERY_MS = 400;
/** And one that somebody else may begin. */
const SELDOM_MS = 4000;

export interface CalibrationDesk {
  /** How it stands, null before the first answer. */
  readonly calibration: Calibration | null;
  /** Why that is not known. */
  readonly error: string | null;
  /** Why the last thing asked for was not done. */
  readonly refusal: string | null;
  readonly asking: boolean;
  /** Ask for something; true when it was done. */
  readonly ask: (act: (droneId: string) => Promise<Calibration>) => Promise<boolean>;
}

/** The calibration of one drone's camera, as it stands and what may be asked of it. */
export function useCalibration(droneId: string): CalibrationDesk {
  const [calibration, setCalibration] = useState<Calibration | null>(null);
  const [error, setError] = useState<string | null>(null);
  const [refusal, setRefusal] = useState<string | null>(null);
  const [asking, setAsking] = useState(false);
  const [acts, setActs] = useState(0);
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let over = false;
    const look = async () => {
      let everyMs = SELDOM_MS;
      try {
        const now = await getCalibration(droneId);
        if (over) return;
        setCalibration(now);
        setError(null);
        if (goesOn(now)) everyMs = EVERY_MS;
      } catch (reason) {
        if (!(reason instanceof RequestError)) throw reason;
        if (over) return;
        setError(reason.message);
      }
      // The next question waits for this answer, however long the line takes for it.
      timer = setTimeout(() => void look(), everyMs);
    };
    void look();
    return () => {
      over = true;
      clearTimeout(timer);
    };
    // What was asked for is looked after at once.
  }, [droneId, acts]);
  const ask = useCallback(
    async (act: (droneId: string) => Promise<Calibration>) => {
      setAsking(true);
      setRefusal(null);
      try {
        setCalibration(await act(droneId));
        return true;
      } catch (reason) {
        if (!(reason instanceof RequestError)) throw reason;
        setRefusal(reason.message);
        return false;
      } finally {
        setAsking(false);
        setActs((times) => times + 1);
      }
    },
    [droneId],
  );
  return { calibration, error, refusal, asking, ask };
}
