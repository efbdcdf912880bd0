import { useState } from "react";
import { getSettings, type Setting } from "../api/setup";
import { useAnswer } from "../api/useAnswer";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { Asking } from "../design/Waiting";
import { LANGUAGES, language, changeLanguage, words, type Language } from "../text/words";
import { boundsText, matches, valueText } from "./setting";

/** Every setting with its meaning and its bounds. They are set when the console starts. */
export function SettingsPanel() {
  const epoch = useConsole((state) => state.epoch);
  const { value: settings, error, asking } = useAnswer(`settings ${epoch}`, getSettings);
  const [wanted, setWanted] = useState("");
  const text = words.setup;
  const found = (settings ?? []).filter((setting) => matches(setting, wanted));
  const groups = [...new Set(found.map((setting) => setting.group))];
  return (
    <Panel title={text.settings} className="settings" aside={<LanguageChoice />}>
      {error !== null && <p className="field-error">{text.unknown(error)}</p>}
      {settings === null && asking && <Asking />}
      <p className="hint">{text.readOnly}</p>
      <label className="field-input">
        {text.search}
        <input
          type="search"
          value={wanted}
          data-testid="settings-search"
          onChange={(event) => {
            setWanted(event.target.value);
          }}
        />
      </label>
      <div className="settings-scroll" tabIndex={0} role="region" aria-label={text.settings}>
        {settings !== null && found.length === 0 && <p className="empty">{text.noSetting}</p>}
        {groups.map((group) => {
          const own = found.filter((setting) => setting.group === group);
          return (
            <details key={`${group} ${wanted === ""}`} open={wanted !== ""}>
              <summary>{text.group(group, own.length)}</summary>
              <ul className="setting-list">
                {own.map((setting) => (
                  <SettingRow key={setting.name} setting={setting} />
                ))}
              </ul>
            </details>
          );
        })}
      </div>
    </Panel>
  );
}

function SettingRow({ setting }: { readonly setting: Setting }) {
  const text = words.setup;
  const value = valueText(setting.value);
  const usual = valueText(setting.default);
  const bounds = boundsText(setting);
  return (
    <li data-testid={`setting-${setting.group}.${setting.name}`}>
      <span className="setting-name">{setting.name}</span>
      <strong className="setting-value">{value}</strong>
      <span className="setting-meaning">{setting.meaning}</span>
      <span className="setting-rest">
        {bounds !== "" && <>{bounds}. </>}
        {value !== usual && <em>{text.usually(usual)} </em>}
        <code>{setting.variable}</code>
      </span>
    </li>
  );
}

function LanguageChoice() {
  return (
    <select
      className="select-small"
      aria-label={words.setup.language}
      data-testid="language"
      value={language}
      onChange={(event) => {
        changeLanguage(event.target.value as Language);
      }}
    >
      {Object.entries(LANGUAGES).map(([code, name]) => (
        <option key={code} value={code} lang={code}>
          {name}
        </option>
      ))}
    </select>
  );
}
