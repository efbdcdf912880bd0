import { useEffect, useRef, useState } from "react";

/** Drawn this often, milliseconds; films run on their own in between. */
const DRAW_MS = 100;

export interface ReplayClock {
  readonly atS: number;
  readonly running: boolean;
  readonly speed: number;
  readonly run: (running: boolean) => void;
  readonly seek: (atS: number) => void;
  readonly setSpeed: (speed: number) => void;
}

/** The clock that all of a replay goes by; it stands at the end, and starts over from there. */
export function useReplayClock(lengthS: number): ReplayClock {
  const [atS, setAtS] = useState(0);
  const [running, setRunning] = useState(false);
  const [speed, setSpeed] = useState(1);
  const last = useRef(0);
  useEffect(() => {
    if (!running) return;
    last.current = performance.now();
    const timer = setInterval(() => {
      const nowMs = performance.now();
      const passedS = (speed * (nowMs - last.current)) / 1000;
      last.current = nowMs;
      setAtS((before) => Math.min(lengthS, before + passedS));
    }, DRAW_MS);
    return () => {
      clearInterval(timer);
    };
  }, [running, speed, lengthS]);
  const over = atS >= lengthS;
  return {
    atS,
    running: running && !over,
    speed,
    run: (next) => {
      if (next && over) setAtS(0);
      setRunning(next);
    },
    seek: setAtS,
    setSpeed,
  };
}
