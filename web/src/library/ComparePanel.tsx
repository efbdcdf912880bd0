import { useState } from "react";
import { artifactUrl, getArtifacts, getCaptureFile, pictureFile } from "../api/library";
import { useAnswer } from "../api/useAnswer";
import { decimal, moment } from "../design/format";
import { Panel } from "../design/Panel";
import { Slider } from "../design/Slider";
import { Asking } from "../design/Waiting";
import { renderingFile } from "../judge/heldOut";
import { hashOfScreen } from "../shell/screens";
import { words } from "../text/words";
import { modeWord } from "./CaptureCard";
import { FilmPair } from "./FilmPair";
import { differences, judgedAlike, winner, type Difference, type Field } from "./run";

const FILM = "orbit.mp4";

interface Pair {
  readonly a: Field;
  readonly b: Field;
}

/** Two fields: films or pictures of both under a slider, and what their figures differ in. */
export function ComparePanel({ a, b }: Pair) {
  const text = words.library;
  return (
    <Panel
      title={text.compareTitle}
      className="compare"
      aside={<a href={hashOfScreen("library", a.entry.id)}>{text.back}</a>}
    >
      <div className="compare-body" data-testid="comparison">
        <Pictures a={a} b={b} />
        <Table a={a} b={b} />
      </div>
    </Panel>
  );
}

function Pictures({ a, b }: Pair) {
  const files = useAnswer(`${a.id} ${b.id}`, () => filesOfBoth(a.id, b.id)).value;
  const films = files?.has(FILM) === true;
  const [chosen, setChosen] = useState("");
  const text = words.library;
  const shown = chosen === "" ? (films ? FILM : "preview.jpg") : chosen;
  return (
    <div>
      {shown === FILM ? (
        <FilmPair a={a.id} b={b.id} altA={text.film(a.name)} altB={text.film(b.name)} />
      ) : (
        <Slider
          a={<img src={artifactUrl(a.id, shown)} alt={text.rendering(a.name)} />}
          b={<img src={artifactUrl(b.id, shown)} alt={text.rendering(b.name)} />}
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
          {pictureChoices(a, b, files ?? new Set()).map(({ file, name }) => (
            <option key={file} value={file}>
              {name}
            </option>
          ))}
        </select>
      </label>
    </div>
  );
}

/** Pictures of two captures, or what two fields make of the same capture's held-out ones. */
function pictureChoices(
  a: Field,
  b: Field,
  files: ReadonlySet<string>,
): readonly { readonly file: string; readonly name: string }[] {
  const text = words.library;
  const numbers = Array.from({ length: Math.min(a.entry.images, b.entry.images) }, (_, index) => index);
  if (a.training === null && b.training === null) {
    return numbers.map((index) => ({ file: pictureFile(index), name: text.taken(index + 1) }));
  }
  if (a.entry.id !== b.entry.id) return [];
  return numbers
    .filter((index) => files.has(renderingFile(index)))
    .map((index) => ({ file: renderingFile(index), name: text.renderedFrom(index + 1) }));
}

/** The files that both runs have. */
async function filesOfBoth(a: string, b: string): Promise<ReadonlySet<string>> {
  const [first, second] = await Promise.all([getArtifacts(a), getArtifacts(b)]);
  const there = new Set(first.map((file) => file.path));
  return new Set(second.map((file) => file.path).filter((path) => there.has(path)));
}

function Table({ a, b }: Pair) {
  const { value: fileA, asking: asksA } = useAnswer(a.entry.id, () => getCaptureFile(a.entry.id));
  const { value: fileB, asking: asksB } = useAnswer(b.entry.id, () => getCaptureFile(b.entry.id));
  const text = words.library;
  return (
    <>
      <div className="table-scroll" tabIndex={0} role="region" aria-label={text.differences}>
        <table className="table differences">
          <thead>
            <tr>
              <th scope="col">{text.figure}</th>
              <th scope="col">A: {a.name}</th>
              <th scope="col">B: {b.name}</th>
              <th scope="col">B − A</th>
            </tr>
          </thead>
          <tbody>
            <tr>
              <th scope="row">{text.started}</th>
              <td>{moment(startOf(a))}</td>
              <td>{moment(startOf(b))}</td>
              <td />
            </tr>
            <tr>
              <th scope="row">{words.mission.form.mode}</th>
              <td>{modeWord(a.entry.mode)}</td>
              <td>{modeWord(b.entry.mode)}</td>
              <td />
            </tr>
            {(a.training !== null || b.training !== null) && (
              <tr>
                <th scope="row">{text.shows}</th>
                <td>{text.part(a.training?.object_only === true)}</td>
                <td>{text.part(b.training?.object_only === true)}</td>
                <td />
              </tr>
            )}
            {differences(a, b, fileA, fileB).map((row) => (
              <Row key={row.key} row={row} />
            ))}
          </tbody>
        </table>
      </div>
      {(asksA || asksB) && <Asking />}
      {a.entry.id !== b.entry.id && <p className="hint">{text.caution}</p>}
      {!judgedAlike(a, b) && <p className="hint">{text.cautionObject}</p>}
    </>
  );
}

function startOf({ entry, training }: Field): string {
  return training === null ? entry.started_at : training.created_at;
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
