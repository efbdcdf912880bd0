import { useState } from "react";

/** Whether something that was begun here is still under way, and how to begin it. */
export function useUnderWay(): readonly [boolean, (work: Promise<unknown>) => void] {
  const [works, setWorks] = useState(0);
  const follow = (work: Promise<unknown>) => {
    setWorks((now) => now + 1);
    void work.finally(() => {
      setWorks((now) => now - 1);
    });
  };
  return [works > 0, follow];
}
