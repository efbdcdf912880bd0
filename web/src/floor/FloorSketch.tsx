import { useRef } from "react";
import type { FloorArea, FloorPoint } from "./area";
import { useFloorGesture, type FloorDrawing, type MarkedArea } from "./useFloorGesture";

/** Something with a place and a heading on the floor, world metres and radians. */
export interface Spot {
  readonly key: string;
  readonly x: number;
  readonly y: number;
  readonly yaw: number;
  readonly colour: string;
  readonly label?: string;
  readonly kind: "drone" | "view" | "ring";
  readonly done?: boolean;
}

interface FloorSketchProps {
  /** Half the edge of what is shown, metres. */
  readonly reachM: number;
  readonly circlesM: readonly { readonly radiusM: number; readonly label: string }[];
  readonly spots: readonly Spot[];
  /** Ways that were flown, world metres. */
  readonly trails?: readonly {
    readonly key: string;
    readonly colour: string;
    readonly points: readonly (readonly [number, number])[];
  }[];
  /** The object's outline, corners in world metres. */
  readonly object: { readonly from: readonly [number, number]; readonly to: readonly [number, number] } | null;
  /** Rectangles that no drone may enter. */
  readonly areas?: readonly MarkedArea[];
  /** When given, rectangles are drawn and moved by dragging. */
  readonly drawing?: FloorDrawing;
  readonly label: string;
}

const NO_AREAS: readonly MarkedArea[] = [];
/** Side of the drawing in its own units. */
const SIDE = 400;
/** A camera with what it looks at before it: a dot, and a wedge that opens along its heading. */
const VIEW = "M-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0-7 0M0 0 20-8M0 0 20 8";
const SQRT_HALF = Math.SQRT1_2;

/** The floor seen from above: +X to the right, +Y up, as the world's axes are. */
export function FloorSketch(props: FloorSketchProps) {
  const { reachM, circlesM, spots, trails = [], areas = NO_AREAS, drawing, object, label } = props;
  const svg = useRef<SVGSVGElement>(null);
  const scale = SIDE / 2 / reachM;
  const place = (x: number, y: number) => [SIDE / 2 + x * scale, SIDE / 2 - y * scale] as const;
  const middle = SIDE / 2;
  const world = (event: React.PointerEvent<SVGSVGElement>): FloorPoint => {
    const toDrawing = svg.current?.getScreenCTM()?.inverse();
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(toDrawing);
    return [(at.x - SIDE / 2) / scale, (SIDE / 2 - at.y) / scale];
  };
  const { shown, drawn, handlers } = useFloorGesture(areas, drawing, world);
  const block = ([x0, y0, x1, y1]: FloorArea) => {
    const [left, top] = place(x0, y1);
    return { x: left, y: top, width: (x1 - x0) * scale, height: (y1 - y0) * scale };
  };
  return (
    <svg
      ref={svg}
      className={`sketch ${drawing === undefined ? "" : "is-drawn-on"}`}
      viewBox={`0 0 ${SIDE} ${SIDE}`}
      role="img"
      aria-label={label}
      {...handlers}
    >
      <path className="sketch-axis" d={`M${middle} 0V${SIDE}M0 ${middle}H${SIDE}`} />
      {circlesM.map((circle) => (
        <g key={circle.label}>
          <circle className="sketch-circle" cx={middle} cy={middle} r={circle.radiusM * scale} />
          {/* Between two drones of four, where nothing else stands. */}
          <text
            className="sketch-note"
            x={middle + SQRT_HALF * circle.radiusM * scale + 6}
            y={middle + SQRT_HALF * circle.radiusM * scale + 14}
          >
            {circle.label}
          </text>
        </g>
      ))}
      {object !== null && <ObjectBox from={place(...object.from)} to={place(...object.to)} />}
      {shown.map((each) => (
        <rect
          key={each.key}
          className={`sketch-no-go ${each.chosen === true ? "is-chosen" : ""}`}
          data-testid={`area-${each.key}`}
          {...block(each.area)}
        >
          <title>{each.label}</title>
        </rect>
      ))}
      {drawn !== null && <rect className="sketch-no-go is-chosen" {...block(drawn)} />}
      {trails.map(({ key, colour, points }) => (
        <polyline
          key={key}
          className="sketch-trail"
          points={points.map(([x, y]) => place(x, y).map((value) => value.toFixed(1)).join()).join(" ")}
          style={{ "--drone": colour } as React.CSSProperties}
        />
      ))}
      {spots.map((spot) => {
        const [x, y] = place(spot.x, spot.y);
        const turn = (-spot.yaw * 180) / Math.PI;
        // The word stands outside the circle.
        const above = spot.y >= 0;
        return (
          <g key={spot.key} className={`spot spot-${spot.kind} ${spot.done === true ? "is-done" : ""}`}>
            <path
              d={spot.kind === "drone" ? "M16 0-9-9-4 0-9 9z" : VIEW}
              transform={`translate(${x} ${y}) rotate(${turn})`}
              style={{ "--drone": spot.colour } as React.CSSProperties}
            />
            {spot.label !== undefined && (
              <text className="sketch-label" x={x} y={y + (above ? -18 : 28)} textAnchor={anchor(spot.x, reachM)}>
                {spot.label}
              </text>
            )}
          </g>
        );
      })}
    </svg>
  );
}

/** Words near an edge run inwards. */
function anchor(x: number, reachM: number): "start" | "middle" | "end" {
  if (Math.abs(x) < 0.5 * reachM) return "middle";
  return x > 0 ? "end" : "start";
}

function ObjectBox(props: { readonly from: readonly [number, number]; readonly to: readonly [number, number] }) {
  const [x0, y0] = props.from;
  const [x1, y1] = props.to;
  return (
    <rect
      className="sketch-object"
      x={Math.min(x0, x1)}
      y={Math.min(y0, y1)}
      width={Math.abs(x1 - x0)}
      height={Math.abs(y1 - y0)}
    />
  );
}
