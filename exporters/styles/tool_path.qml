<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: state of the tool. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips|Temporal">
 <temporal enabled="1" mode="1" startField="end" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="categorizedSymbol" attr="implement" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <categories>
   <category value="down" type="string" symbol="0" label="tool down" render="true"/>
   <category value="up" type="string" symbol="1" label="tool up" render="true"/>
   <category value="unknown" type="string" symbol="2" label="unknown" render="true"/>
  </categories>
  <symbols>
   <symbol type="line" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="90,61,255,255"/>
      <Option name="line_width" type="QString" value="0.7"/>
      <Option name="line_width_unit" type="QString" value="MM"/>
      <Option name="line_style" type="QString" value="solid"/>
      <Option name="capstyle" type="QString" value="round"/>
      <Option name="joinstyle" type="QString" value="round"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="line" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="47,127,184,255"/>
      <Option name="line_width" type="QString" value="0.4"/>
      <Option name="line_width_unit" type="QString" value="MM"/>
      <Option name="line_style" type="QString" value="solid"/>
      <Option name="capstyle" type="QString" value="round"/>
      <Option name="joinstyle" type="QString" value="round"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="line" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="110,110,110,255"/>
      <Option name="line_width" type="QString" value="0.4"/>
      <Option name="line_width_unit" type="QString" value="MM"/>
      <Option name="line_style" type="QString" value="dot"/>
      <Option name="capstyle" type="QString" value="round"/>
      <Option name="joinstyle" type="QString" value="round"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;tool [% "implement" %]&lt;/b&gt;[% if("pass" is null, '', ', pass ' || "pass") %]&lt;br&gt;[% format_date("start", 'HH:mm:ss.zzz') %] to [% format_date("end", 'HH:mm:ss.zzz') %] UTC, [% format_number("length_m", 1) %] m</mapTip>
</qgis>
