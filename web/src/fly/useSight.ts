import { useEffect, type RefObject } from "react";
import { useOperator } from "../context";

/** Say when the picture is scrolled out of sight: it need not be sent then. */
export function useSight(droneId: string, canvas: RefObject<HTMLCanvasElement | null>): void {
  const { tiles } = useOperator();
  useEffect(() => {
    const element = canvas.current;
    if (element === null) return;
    const observer = new IntersectionObserver((entries) => {
      tiles.setInSight(droneId, entries.at(-1)?.isIntersecting ?? true);
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      tiles.setInSight(droneId, true);
    };
  }, [tiles, droneId, canvas]);
}
