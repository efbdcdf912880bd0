import { useEffect, useRef, useState } from "react";
import type { DroneReplay } from "../api/replay";
import { Waiting } from "../design/Waiting";
import { words } from "../text/words";
import { filmCourse } from "./flightCourse";
import type { ReplayClock } from "./useReplayClock";

interface ReplayFilmProps {
  readonly drone: DroneReplay;
  readonly name: string;
  readonly colour: string;
  readonly clock: ReplayClock;
}

/** One drone's video, in step with the replay's clock. */
export function ReplayFilm({ drone, name, colour, clock }: ReplayFilmProps) {
  const video = useRef<HTMLVideoElement>(null);
  const { atS, running, speed } = clock;
  const [loading, setLoading] = useState(true);
  useEffect(() => {
    const film = video.current;
    if (film === null || !(film.duration > 0)) return;
    film.playbackRate = speed;
    const { seekS, plays } = filmCourse(
      { beginsS: drone.begins_s, lengthS: film.duration, currentS: film.currentTime },
      atS,
      running,
    );
    // A film that still looks for its last place is not sent elsewhere: it would never get there.
    if (seekS !== null && !film.seeking) film.currentTime = seekS;
    if (plays === film.paused) {
      if (plays) film.play().catch(() => undefined); // Stopped again before it had begun.
      else film.pause();
    }
  }, [atS, running, speed, drone.begins_s]);
  return (
    <figure className="replay-film" style={{ "--drone": colour } as React.CSSProperties}>
      {drone.film === null ? (
        <span className="run-picture is-empty">{words.fly.neverVideo}</span>
      ) : (
        <video
          ref={video}
          src={drone.film}
          aria-label={words.replay.film(name)}
          data-testid={`replay-${drone.drone_id}`}
          muted
          playsInline
          preload="auto"
          onLoadedData={() => {
            setLoading(false);
          }}
          onError={() => {
            setLoading(false);
          }}
        />
      )}
      {drone.film !== null && loading && (
        <span className="waiting-over">
          <Waiting quiet what={words.replay.filmLoads} />
        </span>
      )}
      <figcaption className="line-drone">{name}</figcaption>
    </figure>
  );
}
