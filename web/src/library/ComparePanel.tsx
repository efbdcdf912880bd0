import { useState } from "react";
import { artifactUrl, getArtifacts, getCaptureFile, pictureFile, type CaptureEntry } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { decimal, moment } from "../design/format";
import { Panel } from "../design/Panel";
import { Slider } from "../design/Slider";
import { Asking } from "../design/Waiting";
import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";
import { modeWord } from "./CaptureCard";
import { FilmPair } from "./FilmPair";
import { differences, winner, type Difference } from "./run";

const FILM = "orbit.mp4";

interface Pair {
  readonly a: CaptureEntry;
  readonly b: CaptureEntry;
}

/** Two captures: films or pictures of both under a slider, and what their figures differ in. */
export function ComparePanel({ a, b }: Pair) {
  const text = words.library;
  return (
    <Panel
      title={text.compareTitle}
      className="compare"
      aside={<a href={hashOfScreen("library", a.id)}>{text.back}</a>}
    >
      <div className="compare-body" data-testid="comparison">
        <Pictures a={a} b={b} />
        <Table a={a} b={b} />
      </div>
    </Panel>
  );
}

function nameOf(entry: CaptureEntry): string {
  return entry.name === "" ? entry.id : entry.name;
}

function Pictures({ a, b }: Pair) {
  const films = useAnswer(`${a.id} ${b.id}`, () => haveFilms(a.id, b.id)).value === true;
  const [chosen, setChosen] = useState("");
  const text = words.library;
  const pictures = Math.min(a.images, b.images);
  const shown = chosen === "" ? (films ? FILM : "preview.jpg") : chosen;
  return (
    <div className="compare-pictures">
      {shown === FILM ? (
        <FilmPair a={a.id} b={b.id} altA={text.film(nameOf(a))} altB={text.film(nameOf(b))} />
      ) : (
        <Slider
          a={<img src={artifactUrl(a.id, shown)} alt={text.rendering(nameOf(a))} />}
          b={<img src={artifactUrl(b.id, shown)} alt={text.rendering(nameOf(b))} />}
          nameA="A"
          nameB="B"
          label={text.slide}
          valueText={text.slideAt}
          testId="compare-slider"
        />
      )}
      <label className="compare-choice">
        {text.picture}
        <select
          className="select-small"
          value={shown}
          onChange={(event) => {
            setChosen(event.target.value);
          }}
        >
          {films && <option value={FILM}>{text.films}</option>}
          <option value="preview.jpg">{text.lastRendering}</option>
          {Array.from({ length: pictures }, (_, index) => (
            <option key={index} value={pictureFile(index)}>
              {text.taken(index + 1)}
            </option>
          ))}
        </select>
      </label>
    </div>
  );
}

async function haveFilms(...captureIds: readonly string[]): Promise<boolean> {
  const all = await Promise.all(captureIds.map(getArtifacts));
  return all.every((files) => files.some((file) => file.path === FILM));
}

function Table({ a, b }: Pair) {
  const { value: fileA, asking: asksA } = useAnswer(a.id, () => getCaptureFile(a.id));
  const { value: fileB, asking: asksB } = useAnswer(b.id, () => getCaptureFile(b.id));
  const text = words.library;
  return (
    <>
      <div className="table-scroll" tabIndex={0} role="region" aria-label={text.differences}>
        <table className="table differences">
          <thead>
            <tr>
              <th scope="col">{text.figure}</th>
              <th scope="col">A: {nameOf(a)}</th>
              <th scope="col">B: {nameOf(b)}</th>
              <th scope="col">B − A</th>
            </tr>
          </thead>
          <tbody>
            <tr>
              <th scope="row">{text.started}</th>
              <td>{moment(a.started_at)}</td>
              <td>{moment(b.started_at)}</td>
              <td />
            </tr>
            <tr>
              <th scope="row">{words.mission.form.mode}</th>
              <td>{modeWord(a.mode)}</td>
              <td>{modeWord(b.mode)}</td>
              <td />
            </tr>
            {differences(a, b, fileA, fileB).map((row) => (
              <Row key={row.key} row={row} />
            ))}
          </tbody>
        </table>
      </div>
      {(asksA || asksB) && <Asking />}
      <p className="hint">{text.caution}</p>
    </>
  );
}

function Row({ row }: { readonly row: Difference }) {
  const { a, b, digits, unit } = row;
  const best = winner(row);
  const value = (number: number | null) =>
    number === null ? words.none : `${decimal(number, digits)} ${unit}`.trim();
  const difference = a === null || b === null ? null : b - a;
  return (
    <tr data-testid={`difference-${row.key}`}>
      <th scope="row">{words.library.row[row.key]}</th>
      <td className={best === "a" ? "is-best" : ""}>
        {value(a)}
        {best === "a" && <small> {words.library.better}</small>}
      </td>
      <td className={best === "b" ? "is-best" : ""}>
        {value(b)}
        {best === "b" && <small> {words.library.better}</small>}
      </td>
      <td>
        {difference === null
          ? words.none
          : `${difference > 0 ? "+" : ""}${value(difference)}`.replace("-", "−")}
      </td>
    </tr>
  );
}
